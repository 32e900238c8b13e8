use super::header::{Element, Kind, Scalar};

/// A mesh attribute and the properties that it is made of.
#[derive(Clone, Debug)]
pub(super) struct AttributePlan {
    pub name: String,
    /// Property indices, 1 or 3.
    pub fields: Vec<usize>,
}

/// More attributes than this are left out: a polygon with many corners repeats each of them for every triangle, so that
/// a small file could ask for much memory.
const MOST_ATTRIBUTES: usize = 16;

/// Names that mean something else than an attribute.
const RESERVED: [&str; 19] = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "u",
    "v",
    "s",
    "t",
    "texture_u",
    "texture_v",
    "r",
    "g",
    "b",
    "red",
    "green",
    "blue",
    "alpha",
];

/// The last letters that Mitsuba groups, one family after the other.
const FAMILIES: [&str; 4] = ["xyzw", "rgba", "0123", "1234"];

/// Finds the attributes of an element by Mitsuba's rules: `r g b` or `red green blue` are `vertex_color` (`face_color`);
/// neighbours `p_x p_y p_z`, `p_r p_g p_b`, `p_0 p_1 p_2` or `p_1 p_2 p_3` are `vertex_p` (with `_color` behind it for
/// the letters rgb), and so is a single `p_x`, `p_r`, `p_0` or `p_1`. Others are left out.
pub(super) fn plan(element: &Element) -> Vec<AttributePlan> {
    let prefix = &element.name;
    let mut plans = Vec::new();
    for names in [["r", "g", "b"], ["red", "green", "blue"]] {
        let fields: Vec<usize> = names.iter().filter_map(|n| scalar(element, n)).collect();
        if fields.len() == 3 && plans.is_empty() {
            plans.push(AttributePlan { name: format!("{prefix}_color"), fields });
        }
    }
    let mut i = 0;
    while i < element.properties.len() {
        let Some((stem, family)) = start(element, i) else {
            i += 1;
            continue;
        };
        let run = FAMILIES[family]
            .chars()
            .enumerate()
            .take_while(|(k, letter)| {
                let property = element.properties.get(i + k);
                property.is_some_and(|p| {
                    matches!(p.kind, Kind::Scalar(_)) && p.name.strip_suffix(*letter) == Some(&format!("{stem}_"))
                })
            })
            .count();
        let colour = if family == 1 { "_color" } else { "" };
        let name = format!("{prefix}_{stem}{colour}");
        if matches!(run, 1 | 3) && plans.iter().all(|p| p.name != name) {
            plans.push(AttributePlan { name, fields: (i..i + run).collect() });
        }
        i += run.max(1);
    }
    plans.truncate(MOST_ATTRIBUTES);
    plans
}

/// The stem and the family of a property that may begin an attribute.
fn start(element: &Element, i: usize) -> Option<(&str, usize)> {
    let p = &element.properties[i];
    let scalar = matches!(p.kind, Kind::Scalar(_)) && !RESERVED.contains(&&p.name[..]);
    let (stem, letter) = scalar.then(|| p.name.rsplit_once('_')).flatten()?;
    let family = FAMILIES.iter().position(|f| letter.len() == 1 && f.starts_with(letter))?;
    (!stem.is_empty()).then_some((stem, family))
}

/// The index of a property that is a single number.
pub(super) fn scalar(element: &Element, name: &str) -> Option<usize> {
    element.find(name).filter(|&i| matches!(element.properties[i].kind, Kind::Scalar(_)))
}

/// An attribute value: integers are sRGB-encoded fractions of their largest value, as in Mitsuba; floats are as they are.
#[inline]
pub(super) fn value(scalar: Scalar, raw: f64) -> f32 {
    if !scalar.is_integer() {
        return raw as f32;
    }
    let encoded = (raw / scalar.unit()).clamp(0.0, 1.0);
    (if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }) as f32
}
