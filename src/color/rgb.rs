use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Neg, Sub};

/// A linear triple in Rec. 709 primaries; the unit is that of the quantity it carries.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Rgb {
    pub r: f32,
    pub g: f32,
    pub b: f32,
}

impl Rgb {
    pub const BLACK: Self = Self::splat(0.0);
    pub const WHITE: Self = Self::splat(1.0);

    #[inline(always)]
    pub const fn new(r: f32, g: f32, b: f32) -> Self {
        Self { r, g, b }
    }

    #[inline(always)]
    pub const fn splat(v: f32) -> Self {
        Self { r: v, g: v, b: v }
    }

    #[inline(always)]
    pub const fn to_array(self) -> [f32; 3] {
        [self.r, self.g, self.b]
    }

    /// Relative luminance (CIE Y of the Rec. 709 primaries).
    #[inline(always)]
    pub fn luminance(self) -> f32 {
        0.212_671 * self.r + 0.715_160 * self.g + 0.072_169 * self.b
    }

    #[inline(always)]
    pub fn max_channel(self) -> f32 {
        self.r.max(self.g).max(self.b)
    }

    #[inline(always)]
    pub fn min_channel(self) -> f32 {
        self.r.min(self.g).min(self.b)
    }

    #[inline(always)]
    pub fn mean(self) -> f32 {
        (self.r + self.g + self.b) * (1.0 / 3.0)
    }

    /// True when every channel is exactly zero.
    #[inline(always)]
    pub fn is_black(self) -> bool {
        self == Self::BLACK
    }

    #[inline(always)]
    pub fn is_finite(self) -> bool {
        self.r.is_finite() && self.g.is_finite() && self.b.is_finite()
    }

    #[inline(always)]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Self::new(f(self.r), f(self.g), f(self.b))
    }

    #[inline(always)]
    pub fn zip(self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self::new(f(self.r, o.r), f(self.g, o.g), f(self.b, o.b))
    }

    /// `self·(1−t) + o·t`.
    #[inline(always)]
    pub fn lerp(self, o: Self, t: f32) -> Self {
        self * (1.0 - t) + o * t
    }
}

impl From<[f32; 3]> for Rgb {
    #[inline(always)]
    fn from([r, g, b]: [f32; 3]) -> Self {
        Self { r, g, b }
    }
}

impl Index<usize> for Rgb {
    type Output = f32;
    #[inline(always)]
    fn index(&self, i: usize) -> &f32 {
        match i {
            0 => &self.r,
            1 => &self.g,
            2 => &self.b,
            _ => panic!("Rgb has channels 0, 1 and 2, not {i}"),
        }
    }
}

macro_rules! channelwise {
    ($($op:ident $f:ident),*) => {$(
        impl $op for Rgb {
            type Output = Rgb;
            #[inline(always)]
            fn $f(self, o: Rgb) -> Rgb {
                Rgb::new(self.r.$f(o.r), self.g.$f(o.g), self.b.$f(o.b))
            }
        }
    )*};
}
channelwise!(Add add, Sub sub, Mul mul, Div div);

impl Mul<f32> for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn mul(self, s: f32) -> Rgb {
        Rgb::new(self.r * s, self.g * s, self.b * s)
    }
}
impl Mul<Rgb> for f32 {
    type Output = Rgb;
    #[inline(always)]
    fn mul(self, c: Rgb) -> Rgb {
        c * self
    }
}
impl Div<f32> for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn div(self, s: f32) -> Rgb {
        Rgb::new(self.r / s, self.g / s, self.b / s)
    }
}
impl Neg for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn neg(self) -> Rgb {
        Rgb::new(-self.r, -self.g, -self.b)
    }
}
impl AddAssign for Rgb {
    #[inline(always)]
    fn add_assign(&mut self, o: Rgb) {
        *self = *self + o;
    }
}
impl MulAssign for Rgb {
    #[inline(always)]
    fn mul_assign(&mut self, o: Rgb) {
        *self = *self * o;
    }
}
impl MulAssign<f32> for Rgb {
    #[inline(always)]
    fn mul_assign(&mut self, s: f32) {
        *self = *self * s;
    }
}
impl std::iter::Sum for Rgb {
    fn sum<I: Iterator<Item = Rgb>>(iter: I) -> Rgb {
        iter.fold(Rgb::BLACK, |a, b| a + b)
    }
}

/// The sRGB transfer curve, encoded to linear (IEC 61966-2-1).
#[inline(always)]
pub fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The inverse of [`srgb_to_linear`].
#[inline(always)]
pub fn linear_to_srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}
