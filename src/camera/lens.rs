use std::f64::consts::PI;

use super::Lens;

/// The image axis that a field of view is measured along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FovAxis {
    #[default]
    X,
    Y,
    Diagonal,
    Smaller,
    Larger,
}

impl FovAxis {
    /// Mitsuba's name of the axis.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "x" => Self::X,
            "y" => Self::Y,
            "diagonal" => Self::Diagonal,
            "smaller" => Self::Smaller,
            "larger" => Self::Larger,
            _ => return None,
        })
    }

    /// The horizontal field of view, in radians like `fov`, on a film of the given width over height.
    pub fn fov_x(self, fov: f64, aspect: f64) -> f64 {
        let half = (0.5 * fov).tan();
        let half_x = match self {
            Self::X => half,
            Self::Y => half * aspect,
            Self::Diagonal => half / (1.0 + 1.0 / (aspect * aspect)).sqrt(),
            Self::Smaller => return if aspect > 1.0 { Self::Y } else { Self::X }.fov_x(fov, aspect),
            Self::Larger => return if aspect > 1.0 { Self::X } else { Self::Y }.fov_x(fov, aspect),
        };
        2.0 * half_x.atan()
    }
}

/// The diagonal field of view (radians) of a 35 mm camera, whose frame is 36 mm by 24 mm, with a lens of `focal` mm.
pub fn fov_from_focal_length(focal: f64) -> f64 {
    2.0 * (36f64.hypot(24.0) / (2.0 * focal)).atan()
}

impl Lens {
    /// Density of uniform points on the lens, per square scene unit.
    pub(super) fn pdf_a(&self) -> f32 {
        (1.0 / (PI * (self.aperture_radius as f64).powi(2))) as f32
    }
}
