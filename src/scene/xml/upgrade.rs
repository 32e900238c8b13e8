//! Names of Mitsuba 0.x in the spelling of Mitsuba 3.

use glam::{DMat4, DVec3};

use super::{Node, Prop, Value};

/// Renames what a Mitsuba 0.x file calls otherwise.
pub(super) fn upgrade(node: &mut Node) {
    for prop in &mut node.props {
        prop.name = snake_case(&prop.name);
    }
    for name in node.children.iter_mut().filter_map(|c| c.name.as_mut()) {
        *name = snake_case(name);
    }
    if let Some(&(_, plugin)) = PLUGINS.iter().find(|(old, _)| *old == node.plugin) {
        node.plugin = plugin.into();
    }
    if node.plugin == "diffuse" {
        for name in
            node.props.iter_mut().map(|p| &mut p.name).chain(node.children.iter_mut().filter_map(|c| c.name.as_mut()))
        {
            if name == "diffuse_reflectance" {
                *name = "reflectance".into();
            }
        }
    }
    uv_transform(node);
}

const PLUGINS: [(&str, &str); 10] = [
    ("lambertian", "diffuse"),
    ("mirror", "conductor"),
    ("roughmetal", "roughconductor"),
    ("roughglass", "roughdielectric"),
    ("ldrtexture", "bitmap"),
    ("exrtexture", "bitmap"),
    ("exrfilm", "hdrfilm"),
    ("pngfilm", "ldrfilm"),
    ("vertexcolors", "mesh_attribute"),
    ("pinhole", "perspective"),
];

/// `toWorld` → `to_world`, `intIOR` → `int_ior`.
pub(super) fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    let mut previous = ' ';
    for c in name.chars() {
        if previous.is_ascii_lowercase() && c.is_ascii_uppercase() {
            out.push('_');
        }
        // Capitals after the first one of a run belong to the same word.
        let in_word = previous.is_ascii_alphabetic() && !out.is_empty();
        out.push(if in_word { c.to_ascii_lowercase() } else { c });
        previous = c;
    }
    out
}

/// `uv · (uscale, vscale) + (uoffset, voffset)` becomes one `to_uv`.
fn uv_transform(node: &mut Node) {
    let mut take = |name: &str, default: f64| {
        let Some(i) = node.props.iter().position(|p| p.name == name) else { return (default, None) };
        match node.props[i].value {
            Value::Float(v) => (v, Some(node.props.remove(i).pos)),
            Value::Int(v) => (v as f64, Some(node.props.remove(i).pos)),
            _ => (default, None),
        }
    };
    let [u_scale, v_scale] = [take("uscale", 1.0), take("vscale", 1.0)];
    let [u_offset, v_offset] = [take("uoffset", 0.0), take("voffset", 0.0)];
    let pos = [u_scale.1, v_scale.1, u_offset.1, v_offset.1].into_iter().flatten().next();
    if let Some(pos) = pos {
        let m = DMat4::from_translation(DVec3::new(u_offset.0, v_offset.0, 0.0))
            * DMat4::from_scale(DVec3::new(u_scale.0, v_scale.0, 1.0));
        node.props.push(Prop { name: "to_uv".into(), value: Value::Transform(m), pos });
    }
}

#[cfg(test)]
mod tests {
    use super::snake_case;

    #[test]
    fn camel_case_becomes_snake_case() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("maxDepth", "max_depth"),
            ("globalLookupRadius", "global_lookup_radius"),
            ("hide_emitters", "hide_emitters"),
            ("alphaU", "alpha_u"),
            ("", ""),
        ] {
            assert_eq!(snake_case(old), new);
        }
    }
}
