//! How cost grows as scenes become stiff: rays and time for each path against the parameter that goes to its limit.

use plotters::prelude::*;
use std::time::Instant;

use super::case::{Case, Check, Item, Outcome};
use super::probe::{load, render_once};
use super::xml::*;
use crate::accel::AccelKind;

/// One stiff parameter.
pub struct Curve {
    pub name: &'static str,
    pub parameter: &'static str,
    /// What theory says that a path costs.
    pub theory: &'static str,
    pub points: Vec<Point>,
}

/// The cost of a path.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub parameter: f64,
    /// Closest-hit rays that theory gives.
    pub theory: f64,
    /// Closest-hit rays that were traced.
    pub rays: f64,
    /// Wall-clock time, microseconds.
    pub micros: f64,
}

impl Curve {
    /// Exponent of the rays against theory between the first and the last point: 1 when they grow alike.
    pub fn exponent(&self) -> f64 {
        match (self.points.first(), self.points.last()) {
            (Some(a), Some(b)) => (b.rays / a.rays).ln() / (b.theory / a.theory).ln(),
            _ => f64::NAN,
        }
    }

    /// The same of time, which may not grow faster.
    pub fn time_exponent(&self) -> f64 {
        match (self.points.first(), self.points.last()) {
            (Some(a), Some(b)) => (b.micros / a.micros).ln() / (b.theory / a.theory).ln(),
            _ => f64::NAN,
        }
    }
}

/// Rays and time for each sample of a picture made by path tracing.
fn measure(xml: &str, accel: AccelKind, spp: u64, parameter: f64, theory: f64) -> Point {
    let scene = load(xml, &[], accel).unwrap_or_else(|e| panic!("the program's own scene: {e}"));
    let started = Instant::now();
    let counters = render_once(&scene, "path", spp, 0, 1, None).summary.counters;
    let paths = counters.samples as f64;
    Point {
        parameter,
        theory,
        rays: counters.camera_rays as f64 / paths,
        micros: 1e6 * started.elapsed().as_secs_f64() / paths,
    }
}

/// A furnace: roulette ends a path with probability 1 − ρ, so that it has 1/(1 − ρ) edges.
pub fn furnace(accel: AccelKind) -> Curve {
    let at = |&loss: &f64| {
        let room = hollow([0.0; 3], 1.0, &(diffuse(1.0 - loss) + &emits(loss)));
        let integrator = r#"<integrator type="path"><integer name="rr_depth" value="1"/></integrator>"#.to_owned();
        let xml = scene(&[integrator, camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (16, 16)), room]);
        measure(&xml, accel, (2000.0 * loss).clamp(2.0, 256.0) as u64, loss, 1.0 / loss)
    };
    let points = [0.5, 0.2, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4].iter().map(at).collect();
    Curve { name: "furnace", parameter: "1 − albedo", theory: "1/(1 − ρ) edges", points }
}

/// A glass rod, entered at 30°: tan θ' reflections by its sides for each width of its length. A path enters with probability
/// 1 − R and crosses the rod 1/(1 − R) times, once on average; two edges more are outside.
pub fn guide(accel: AccelKind) -> Curve {
    let at = |&length: &f64| {
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let xml = scene(&[
            depth(-1),
            parallel_camera([0.2 * sin, 0.0, 0.2 * cos], [0.0; 3], 0.1, 16),
            cuboid([0.0, 0.0, -0.5 * length], [0.5, 0.5, 0.5 * length], &glass(1.5)),
            square([0.0, 0.0, -length - 0.1], 100.0, [0.0, 0.0, 1.0], &lamp(1.0)),
        ]);
        let tan = (sin / 1.5).asin().tan();
        let bounces = length * tan + 1.0;
        measure(&xml, accel, 32, length, 2.0 + bounces)
    };
    let points = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0].iter().map(at).collect();
    Curve { name: "light guide", parameter: "length in widths", theory: "L tan θ' reflections", points }
}

/// A box of mirrors that lose a share of the light: 1/(1 − r) edges. They glow, or nothing would be traced at all.
pub fn mirror_box(accel: AccelKind) -> Curve {
    let at = |&loss: &f64| {
        let mirror =
            format!(r#"<bsdf type="conductor"><rgb name="specular_reflectance" value="{}"/></bsdf>"#, 1.0 - loss);
        let inside = r#"<boolean name="flip_normals" value="true"/>"#.to_owned() + &mirror + &emits(loss);
        let room = cuboid([0.0; 3], [1.0; 3], &inside);
        let integrator = r#"<integrator type="path"><integer name="rr_depth" value="1"/></integrator>"#.to_owned();
        let xml = scene(&[integrator, camera([0.1, 0.2, -0.3], [0.5, 0.1, 1.0], 90.0, (16, 16)), room]);
        measure(&xml, accel, (2000.0 * loss).clamp(2.0, 256.0) as u64, loss, 1.0 / loss)
    };
    let points = [0.5, 0.2, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4].iter().map(at).collect();
    Curve { name: "mirror box", parameter: "1 − reflectance", theory: "1/(1 − r) edges", points }
}

/// All curves.
pub fn curves() -> Vec<Curve> {
    [furnace, guide, mirror_box].map(|f| f(AccelKind::Auto)).into()
}

pub fn cases() -> Vec<Case> {
    vec![Case {
        name: "stiffness",
        about: "rays per path grow as theory says in furnaces, light guides and mirror boxes",
        items: checks,
    }]
}

fn checks() -> Vec<Item> {
    let of = |name: &str, f: fn(AccelKind) -> Curve| {
        Check::new(format!("{name}: exponent of rays against theory"), "path", move |accel, _| {
            let curve = f(accel);
            Outcome::exact(1.0, curve.exponent()).note(format!("exponent of time {:.2}", curve.time_exponent()))
        })
        .relative(0.05)
        .limit(60.0)
        .slow()
        .into()
    };
    vec![of("furnace", furnace), of("light guide", guide), of("mirror box", mirror_box)]
}

/// The curves as a picture: rays, time and theory against the parameter, logarithmic both ways.
pub fn svg(curves: &[Curve]) -> String {
    let mut out = String::new();
    {
        let root = SVGBackend::with_string(&mut out, (420 * curves.len() as u32, 360)).into_drawing_area();
        let panels = root.split_evenly((1, curves.len().max(1)));
        for (panel, curve) in panels.iter().zip(curves) {
            // Drawing into a string cannot fail but for an empty range.
            let _ = draw(panel, curve);
        }
        let _ = root.present();
    }
    out
}

type Panel<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

fn draw(panel: &Panel, curve: &Curve) -> Result<(), Box<dyn std::error::Error>> {
    panel.fill(&WHITE)?;
    let values = |f: fn(&Point) -> f64| curve.points.iter().map(move |p| (p.parameter, f(p)));
    let xs = || curve.points.iter().map(|p| p.parameter);
    let (x0, x1) = (xs().fold(f64::INFINITY, f64::min), xs().fold(0.0, f64::max));
    let ys = || curve.points.iter().flat_map(|p| [p.theory, p.rays, p.micros]);
    let (y0, y1) = (ys().fold(f64::INFINITY, f64::min), ys().fold(0.0, f64::max));
    let mut chart = ChartBuilder::on(panel)
        .caption(curve.name, ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(40)
        .y_label_area_size(50)
        .build_cartesian_2d((x0..x1).log_scale(), (0.7 * y0..1.5 * y1).log_scale())?;
    let plain = |v: &f64| format!("{v}");
    chart
        .configure_mesh()
        .x_desc(curve.parameter)
        .y_desc("for each path")
        .x_label_formatter(&plain)
        .y_label_formatter(&plain)
        .light_line_style(WHITE)
        .draw()?;
    chart
        .draw_series(LineSeries::new(values(|p| p.theory), BLACK.stroke_width(1)))?
        .label(curve.theory)
        .legend(|(x, y)| PathElement::new([(x, y), (x + 16, y)], BLACK));
    let (red, blue) = (RGBColor(200, 60, 30), RGBColor(30, 90, 180));
    let rays: Vec<(f64, f64)> = values(|p| p.rays).collect();
    let time: Vec<(f64, f64)> = values(|p| p.micros).collect();
    for (points, color, label) in [(rays, red, "rays"), (time, blue, "µs")] {
        chart.draw_series(LineSeries::new(points.clone(), color.stroke_width(1)))?;
        chart
            .draw_series(points.into_iter().map(|p| Circle::new(p, 3, color.filled())))?
            .label(label)
            .legend(move |(x, y)| Circle::new((x + 8, y), 3, color.filled()));
    }
    // The legend stands where the curves are not.
    let ends = curve.points.first().zip(curve.points.last());
    let rises = ends.is_some_and(|(a, b)| (b.theory > a.theory) == (b.parameter > a.parameter));
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.2))
        .position(if rises { SeriesLabelPosition::UpperLeft } else { SeriesLabelPosition::LowerLeft })
        .draw()?;
    Ok(())
}
