//! Spectra to linear Rec. 709.
//!
//! The CIE 1931 colour matching functions are the sums of asymmetric Gaussian lobes of [Wyman, Sloan, Shirley 2013,
//! "Simple analytic approximations to the CIE XYZ color matching functions", listing 1].

use super::Rgb;

/// What light a tabulated spectrum is seen under.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Illuminant {
    /// CIE standard illuminant D65: the spectrum is a reflectance, and constant 1 is white (1, 1, 1).
    D65,
    /// None: the spectrum is emission, and constant 1 has XYZ = (1, 1, 1).
    EqualEnergy,
}

const FIRST_NM: u32 = 360;
const LAST_NM: u32 = 830;

/// x̄, ȳ, z̄ at a wavelength in nm.
pub fn cie_xyz(wavelength: f64) -> [f64; 3] {
    let lobe = |mean: f64, below: f64, above: f64| {
        let t = (wavelength - mean) * if wavelength < mean { below } else { above };
        (-0.5 * t * t).exp()
    };
    [
        0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.0490, 0.0382),
        0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322),
        1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725),
    ]
}

/// Relative power of D65 every 10 nm from 360 to 830 nm (CIE 15).
const D65: [f64; 48] = [
    46.6383, 52.0891, 49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861,
    115.923, 108.811, 109.354, 107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856,
    90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490,
    61.6040, 69.8856, 75.0870, 63.5927, 46.4182, 66.8054, 63.3828, 64.3040, 59.4519, 51.9590, 57.4406, 60.3125,
];

fn d65(wavelength: f64) -> f64 {
    let x = ((wavelength - f64::from(FIRST_NM)) / 10.0).clamp(0.0, 46.999_999);
    let (i, t) = (x as usize, x.fract());
    D65[i] * (1.0 - t) + D65[i + 1] * t
}

/// ∫ f(λ) x̄ȳz̄(λ) dλ by the midpoint rule at 1 nm.
fn integrate(f: impl Fn(f64) -> f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for nm in FIRST_NM..LAST_NM {
        let wavelength = f64::from(nm) + 0.5;
        let value = f(wavelength);
        for (s, c) in sum.iter_mut().zip(cie_xyz(wavelength)) {
            *s += value * c;
        }
    }
    sum
}

/// CIE XYZ to linear Rec. 709 with the D65 white point (IEC 61966-2-1).
pub fn xyz_to_rgb([x, y, z]: [f64; 3]) -> [f64; 3] {
    [
        3.240_479 * x - 1.537_150 * y - 0.498_535 * z,
        -0.969_256 * x + 1.875_991 * y + 0.041_556 * z,
        0.055_648 * x - 0.204_043 * y + 1.057_311 * z,
    ]
}

/// The colour of a spectrum that is linear between its (wavelength nm, value) samples and zero outside of them.
/// Channels may be negative when the spectrum is more saturated than the primaries.
pub fn spectrum_to_rgb(samples: &[(f64, f64)], illuminant: Illuminant) -> Rgb {
    let value = |wavelength: f64| {
        let above = samples.partition_point(|s| s.0 < wavelength);
        match (above.checked_sub(1).and_then(|i| samples.get(i)), samples.get(above)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (wavelength - a.0) / (b.0 - a.0),
            _ => 0.0,
        }
    };
    match illuminant {
        Illuminant::D65 => {
            // The white of the fit is off by some 0.1 %: divide it out so that constant 1 is exactly white.
            let white = xyz_to_rgb(integrate(d65));
            let rgb = xyz_to_rgb(integrate(|w| d65(w) * value(w)));
            Rgb::from(std::array::from_fn(|i| (rgb[i] / white[i]) as f32))
        }
        Illuminant::EqualEnergy => equal_energy(value),
    }
}

/// Colour of a radiance spectrum such that constant 1 has XYZ = (1, 1, 1).
fn equal_energy(value: impl Fn(f64) -> f64) -> Rgb {
    let one = integrate(|_| 1.0);
    let xyz = integrate(value);
    Rgb::from(xyz_to_rgb(std::array::from_fn(|i| xyz[i] / one[i])).map(|v| v as f32))
}

/// Spectral radiance of a black body (W·m⁻²·sr⁻¹·nm⁻¹) at a temperature in kelvin, as a colour.
/// Planck's law with the exact SI constants.
pub fn blackbody_to_rgb(temperature: f64) -> Rgb {
    equal_energy(|nm| planck(nm, temperature))
}

fn planck(nm: f64, temperature: f64) -> f64 {
    const H: f64 = 6.626_070_15e-34;
    const C: f64 = 299_792_458.0;
    const K: f64 = 1.380_649e-23;
    let wavelength = nm * 1e-9;
    1e-9 * 2.0 * H * C * C / (wavelength.powi(5) * (H * C / (wavelength * K * temperature)).exp_m1())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: Rgb, b: [f32; 3], tolerance: f32) -> bool {
        a.to_array().iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance)
    }

    #[test]
    fn constant_spectra() {
        let flat = [(300.0, 1.0), (900.0, 1.0)];
        assert!(close(spectrum_to_rgb(&flat, Illuminant::D65), [1.0; 3], 1e-6));
        // XYZ (1, 1, 1) in the primaries.
        assert!(close(spectrum_to_rgb(&flat, Illuminant::EqualEnergy), [1.204_794, 0.948_291, 0.908_916], 1e-5));
    }

    #[test]
    fn white_of_the_fit_is_near_d65() {
        // CIE 15: D65 has XYZ (0.95047, 1, 1.08883); the fit's stated mean error is about 1 %.
        let [x, y, z] = integrate(d65);
        assert!((x / y - 0.95047).abs() < 0.01 && (z / y - 1.08883).abs() < 0.015, "{} {}", x / y, z / y);
    }

    #[test]
    fn planck_is_right() {
        // Wien: the maximum of B_λ is at 2.897771955e6 nm K / T, here 579.55 nm for 5000 K.
        assert!(planck(579.55, 5000.0) > planck(577.0, 5000.0) && planck(579.55, 5000.0) > planck(582.0, 5000.0));
        // ∫ B dλ = σ T⁴ / π.
        let total: f64 = (100..100_000).map(|nm| planck(f64::from(nm) + 0.5, 5000.0)).sum();
        let expected = 5.670_374_419e-8 * 5000f64.powi(4) / std::f64::consts::PI;
        assert!((total / expected - 1.0).abs() < 1e-3, "{total} {expected}");
        // Warmer than white: more red than blue.
        let c = blackbody_to_rgb(2700.0);
        assert!(c.r > c.g && c.g > c.b);
    }
}
