//! Refractive indices by the names that scene files use.

/// Names and indices at about 589 nm, from common handbook tables (CRC Handbook of Chemistry and Physics).
pub const IOR_NAMES: [(&str, f64); 23] = [
    ("vacuum", 1.0),
    ("helium", 1.000036),
    ("hydrogen", 1.000132),
    ("air", 1.000277),
    ("carbon dioxide", 1.00045),
    ("water ice", 1.31),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("fused quartz", 1.458),
    ("carbon tetrachloride", 1.461),
    ("pyrex", 1.47),
    ("glycerol", 1.4729),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("benzene", 1.501),
    ("bk7", 1.5046),
    ("silicone oil", 1.52045),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("bromine", 1.661),
    ("diamond", 2.419),
];

/// Index of a named medium; letter case does not matter.
pub fn ior_by_name(name: &str) -> Option<f64> {
    IOR_NAMES.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|&(_, ior)| ior)
}
