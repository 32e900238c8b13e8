//! Pieces of scene files.

/// A scene of these pieces.
pub fn scene(pieces: &[String]) -> String {
    format!("<scene version=\"3.0.0\">\n{}\n</scene>", pieces.join("\n"))
}

/// The depth for all methods; −1 is unlimited. Photon mapping by small maps, whose estimates may be wide: every expected
/// value here is smooth.
pub fn depth(max_depth: i64) -> String {
    photon_mapper(&[
        ("integer", "max_depth", max_depth.to_string()),
        ("integer", "lookup_size", "60".into()),
        ("float", "global_lookup_radius", "0.25".into()),
        ("float", "caustic_lookup_radius", "0.05".into()),
    ])
}

/// A photon mapper with parameters, each `(kind, name, value)`.
pub fn photon_mapper(params: &[(&str, &str, String)]) -> String {
    integrator("photonmapper", params)
}

/// Progressive photon mapping with parameters.
pub fn progressive(params: &[(&str, &str, String)]) -> String {
    integrator("sppm", params)
}

fn integrator(name: &str, params: &[(&str, &str, String)]) -> String {
    let params: String =
        params.iter().map(|(kind, name, value)| format!(r#"<{kind} name="{name}" value="{value}"/>"#)).collect();
    format!(r#"<integrator type="{name}">{params}</integrator>"#)
}

pub type V3 = [f64; 3];

fn point((x, y, z): (f64, f64, f64)) -> String {
    format!("{x}, {y}, {z}")
}

fn p([x, y, z]: V3) -> String {
    point((x, y, z))
}

fn film(width: u32, height: u32) -> String {
    format!(
        r#"<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
           <rfilter type="box"/></film>"#
    )
}

/// Any direction across `view` to call up.
fn up(view: V3) -> V3 {
    if view[2].abs() > 0.9 * (view[0].abs() + view[1].abs()) { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] }
}

fn look(origin: V3, target: V3) -> String {
    let view = [target[0] - origin[0], target[1] - origin[1], target[2] - origin[2]];
    format!(r#"<lookat origin="{}" target="{}" up="{}"/>"#, p(origin), p(target), p(up(view)))
}

/// A pinhole camera, `fov` degrees wide.
pub fn camera(origin: V3, target: V3, fov: f64, (width, height): (u32, u32)) -> String {
    format!(
        r#"<sensor type="perspective"><float name="fov" value="{fov}"/><transform name="to_world">{}</transform>{}</sensor>"#,
        look(origin, target),
        film(width, height)
    )
}

/// A camera of parallel rays over a square of side `2·half`, in front of which nothing is cut off.
pub fn parallel_camera(origin: V3, target: V3, half: f64, pixels: u32) -> String {
    format!(
        r#"<sensor type="orthographic"><transform name="to_world"><scale value="{half}"/>{}</transform>{}</sensor>"#,
        look(origin, target),
        film(pixels, pixels)
    )
}

/// The square of side `2·half` around `center` whose normal points along `normal`, an axis.
pub fn square(center: V3, half: f64, normal: V3, inside: &str) -> String {
    rectangle(center, (half, half), normal, inside)
}

/// As [`square`], with two half sides. For normals ±z the first lies along x and the second along y; for ±x they lie along
/// z and y; for ±y along x and z.
pub fn rectangle(center: V3, (a, b): (f64, f64), normal: V3, inside: &str) -> String {
    let turn = match normal {
        [0.0, 0.0, z] if z > 0.0 => String::new(),
        [0.0, 0.0, _] => r#"<rotate x="1" angle="180"/>"#.into(),
        [x, 0.0, 0.0] => format!(r#"<rotate y="1" angle="{}"/>"#, 90.0 * x.signum()),
        [_, y, _] => format!(r#"<rotate x="1" angle="{}"/>"#, -90.0 * y.signum()),
    };
    let [x, y, z] = center;
    format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale x="{a}" y="{b}" z="1"/>{turn}<translate x="{x}" y="{y}" z="{z}"/></transform>{inside}</shape>"#
    )
}

/// A disc with its normal along ±z.
pub fn disc(center: V3, radius: f64, up: bool, inside: &str) -> String {
    let turn = if up { "" } else { r#"<rotate x="1" angle="180"/>"# };
    let [x, y, z] = center;
    format!(
        r#"<shape type="disk"><transform name="to_world"><scale x="{radius}" y="{radius}" z="1"/>{turn}<translate x="{x}" y="{y}" z="{z}"/></transform>{inside}</shape>"#
    )
}

/// A sphere whose normals point outwards.
pub fn sphere(center: V3, radius: f64, inside: &str) -> String {
    let [x, y, z] = center;
    format!(
        r#"<shape type="sphere"><point name="center" x="{x}" y="{y}" z="{z}"/><float name="radius" value="{radius}"/>{inside}</shape>"#
    )
}

/// A sphere whose normals point inwards.
pub fn hollow(center: V3, radius: f64, inside: &str) -> String {
    sphere(center, radius, &format!(r#"<boolean name="flip_normals" value="true"/>{inside}"#))
}

/// The box around `center` with these half sides.
pub fn cuboid(center: V3, half: V3, inside: &str) -> String {
    let ([x, y, z], [a, b, c]) = (center, half);
    format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="{a}" y="{b}" z="{c}"/><translate x="{x}" y="{y}" z="{z}"/></transform>{inside}</shape>"#
    )
}

/// A mesh from a file of the probe.
pub fn mesh(file: &str, inside: &str) -> String {
    format!(r#"<shape type="ply"><string name="filename" value="{file}"/>{inside}</shape>"#)
}

pub fn diffuse(albedo: f64) -> String {
    format!(r#"<bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf>"#)
}

pub fn black() -> String {
    diffuse(0.0)
}

pub fn mirror() -> String {
    r#"<bsdf type="conductor"/>"#.into()
}

/// A smooth dielectric against vacuum.
pub fn glass(ior: f64) -> String {
    format!(r#"<bsdf type="dielectric"><float name="int_ior" value="{ior}"/><float name="ext_ior" value="1"/></bsdf>"#)
}

/// A smooth dielectric that fills its shape where nothing of a higher priority is, against vacuum.
pub fn filling(ior: f64, priority: i32) -> String {
    let inner = format!(r#"<integer name="priority" value="{priority}"/></bsdf>"#);
    glass(ior).replace("</bsdf>", &inner)
}

/// A smooth dielectric between two media.
pub fn interface(inside: f64, outside: f64) -> String {
    glass(inside).replace(r#"name="ext_ior" value="1""#, &format!(r#"name="ext_ior" value="{outside}""#))
}

/// Area emission; the radiance in W·m⁻²·sr⁻¹.
pub fn emits(radiance: f64) -> String {
    format!(r#"<emitter type="area"><rgb name="radiance" value="{radiance}"/></emitter>"#)
}

/// A black surface that emits.
pub fn lamp(radiance: f64) -> String {
    black() + &emits(radiance)
}

/// A point light; intensity in W·sr⁻¹.
pub fn point_light(position: V3, intensity: f64) -> String {
    let [x, y, z] = position;
    format!(
        r#"<emitter type="point"><point name="position" x="{x}" y="{y}" z="{z}"/><rgb name="intensity" value="{intensity}"/></emitter>"#
    )
}

/// A parallel beam everywhere; irradiance in W·m⁻² across it.
pub fn sun(direction: V3, irradiance: f64) -> String {
    let [x, y, z] = direction;
    format!(
        r#"<emitter type="directional"><vector name="direction" x="{x}" y="{y}" z="{z}"/><rgb name="irradiance" value="{irradiance}"/></emitter>"#
    )
}

/// The same radiance from everywhere outside.
pub fn sky(radiance: f64) -> String {
    format!(r#"<emitter type="constant"><rgb name="radiance" value="{radiance}"/></emitter>"#)
}
