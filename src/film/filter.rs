use std::f32::consts::PI;

/// How samples are spread over the pixels around them. Separable; distances in pixels from the pixel's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReconstructionFilter {
    /// Every sample belongs to its own pixel.
    Box,
    Tent {
        radius: f32,
    },
    /// Cut off at four standard deviations and lowered to end at zero.
    Gaussian {
        stddev: f32,
    },
    /// [Mitchell and Netravali 1988].
    Mitchell {
        b: f32,
        c: f32,
    },
    CatmullRom,
    Lanczos {
        lobes: u32,
    },
}

impl Default for ReconstructionFilter {
    fn default() -> Self {
        Self::Gaussian { stddev: 0.5 }
    }
}

/// Pixels on each side that a filter may reach.
pub const MAX_RADIUS: f32 = 15.0;

impl ReconstructionFilter {
    /// The filter with Mitsuba's name and default parameters.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "box" => Self::Box,
            "tent" => Self::Tent { radius: 1.0 },
            "gaussian" => Self::Gaussian { stddev: 0.5 },
            "mitchell" => Self::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
            "catmullrom" => Self::CatmullRom,
            "lanczos" => Self::Lanczos { lobes: 3 },
            _ => return None,
        })
    }

    /// Half width in pixels, at most [`MAX_RADIUS`].
    pub fn radius(&self) -> f32 {
        let radius = match *self {
            Self::Box => 0.5,
            Self::Tent { radius } => radius,
            Self::Gaussian { stddev } => 4.0 * stddev,
            Self::Mitchell { .. } | Self::CatmullRom => 2.0,
            Self::Lanczos { lobes } => lobes as f32,
        };
        radius.clamp(0.0, MAX_RADIUS)
    }

    /// The filter at distance `x`; 0 from the radius on.
    #[inline]
    pub fn eval(&self, x: f32) -> f32 {
        let x = x.abs();
        match *self {
            Self::Box => (x <= 0.5) as u32 as f32,
            Self::Tent { radius } => (1.0 - x / radius).max(0.0),
            Self::Gaussian { stddev } => {
                let alpha = -0.5 / (stddev * stddev);
                let radius = 4.0 * stddev;
                ((alpha * x * x).exp() - (alpha * radius * radius).exp()).max(0.0)
            }
            Self::Mitchell { b, c } => cubic(x, b, c),
            Self::CatmullRom => cubic(x, 0.0, 0.5),
            Self::Lanczos { lobes } => windowed_sinc(x, lobes as f32),
        }
    }

    /// ∫ of the filter, by which splats are divided.
    pub fn integral(&self) -> f64 {
        2.0 * self.integral_to(self.radius())
    }

    /// ∫ of the filter from its centre to the distance `reach`, at most its radius.
    pub fn integral_to(&self, reach: f32) -> f64 {
        // The midpoint rule; exact to 1e-7 for these smooth pieces.
        let (n, r) = (4096, reach.min(self.radius()) as f64);
        let step = r / n as f64;
        (0..n).map(|i| self.eval(((i as f64 + 0.5) * step) as f32) as f64).sum::<f64>() * step
    }
}

/// The cubic of [Mitchell and Netravali 1988, eq. 8].
fn cubic(x: f32, b: f32, c: f32) -> f32 {
    let (x2, x3) = (x * x, x * x * x);
    let sixfold = if x < 1.0 {
        (12.0 - 9.0 * b - 6.0 * c) * x3 + (-18.0 + 12.0 * b + 6.0 * c) * x2 + (6.0 - 2.0 * b)
    } else if x < 2.0 {
        (-b - 6.0 * c) * x3 + (6.0 * b + 30.0 * c) * x2 + (-12.0 * b - 48.0 * c) * x + (8.0 * b + 24.0 * c)
    } else {
        0.0
    };
    sixfold / 6.0
}

fn windowed_sinc(x: f32, lobes: f32) -> f32 {
    if x >= lobes {
        return 0.0;
    }
    let sinc = |t: f32| if t < 1e-4 { 1.0 - t * t / 6.0 } else { t.sin() / t };
    sinc(PI * x) * sinc(PI * x / lobes)
}
