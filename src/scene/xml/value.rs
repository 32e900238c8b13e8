//! Text to numbers.

use glam::DVec3;

/// A finite number; surrounding blanks are allowed.
pub(super) fn float(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        Ok(_) => Err(format!("\"{}\" is not a finite number", brief(text))),
        Err(_) => Err(format!("\"{}\" is not a number", brief(text))),
    }
}

pub(super) fn integer(text: &str) -> Result<i64, String> {
    text.trim().parse().map_err(|_| format!("\"{}\" is not an integer", brief(text)))
}

pub(super) fn boolean(text: &str) -> Result<bool, String> {
    match text.trim().to_ascii_lowercase().as_str() {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err(format!("\"{}\" is neither \"true\" nor \"false\"", brief(text))),
    }
}

/// Numbers separated by commas or blanks.
pub(super) fn floats(text: &str) -> Result<Vec<f64>, String> {
    tokens(text).map(float).collect()
}

/// Three numbers, or one that stands for all three.
pub(super) fn triple(text: &str) -> Result<DVec3, String> {
    match floats(text)?[..] {
        [v] => Ok(DVec3::splat(v)),
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        ref other => Err(format!("\"{}\" has {} numbers where 3 (or 1) are needed", brief(text), other.len())),
    }
}

/// `r, g, b`, one grey value, or `#rrggbb` (read as linear, as in Mitsuba 0.6).
pub(super) fn rgb(text: &str) -> Result<[f64; 3], String> {
    let Some(hex) = text.trim().strip_prefix('#') else {
        return triple(text).map(|v| v.to_array());
    };
    match u32::from_str_radix(hex, 16) {
        Ok(v) if hex.len() == 6 && hex.bytes().all(|b| b.is_ascii_hexdigit()) => {
            Ok([16, 8, 0].map(|shift| f64::from((v >> shift) & 0xff) / 255.0))
        }
        _ => Err(format!("\"{}\" is not a colour of the form #rrggbb", brief(text))),
    }
}

/// `λ:value` pairs with rising wavelengths.
pub(super) fn spectrum_samples(text: &str) -> Result<Vec<(f64, f64)>, String> {
    let mut samples = Vec::new();
    for token in tokens(text) {
        let Some((wavelength, value)) = token.split_once(':') else {
            return Err(format!("\"{}\" is not of the form wavelength:value", brief(token)));
        };
        samples.push((float(wavelength)?, float(value)?));
    }
    check_samples(samples)
}

/// Lines of `λ value`, with `#` comments.
pub(super) fn spectrum_file(text: &str) -> Result<Vec<(f64, f64)>, String> {
    let mut samples = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        match floats(line).map_err(|e| format!("line {}: {e}", number + 1))?[..] {
            [wavelength, value] => samples.push((wavelength, value)),
            _ => return Err(format!("line {}: \"{}\" is not a wavelength and a value", number + 1, brief(line))),
        }
    }
    check_samples(samples)
}

pub(super) fn check_samples(samples: Vec<(f64, f64)>) -> Result<Vec<(f64, f64)>, String> {
    if samples.len() < 2 {
        return Err("a spectrum needs at least two wavelength:value pairs".into());
    }
    if samples.windows(2).any(|w| w[0].0 >= w[1].0) {
        return Err("the wavelengths of a spectrum must increase".into());
    }
    Ok(samples)
}

pub(super) fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty())
}

/// Enough of a text to recognise it in a message.
pub(super) fn brief(text: &str) -> String {
    let text = text.trim();
    if text.chars().nth(60).is_none() { text.into() } else { text.chars().take(57).chain("...".chars()).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        assert_eq!(float(" 1.5e3 "), Ok(1500.0));
        assert!(float("nan").is_err() && float("1e999").is_err() && float("").is_err() && float("1,5").is_err());
        assert_eq!(triple("1, 2  3"), Ok(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!(triple("2"), Ok(DVec3::splat(2.0)));
        assert!(triple("1 2").is_err() && triple("").is_err());
        assert!(boolean("True").is_ok_and(|b| b) && boolean("yes").is_err());
    }

    #[test]
    fn colours() {
        assert_eq!(rgb("#ff0080"), Ok([1.0, 0.0, 128.0 / 255.0]));
        assert!(rgb("#ff00").is_err() && rgb("#+f0080").is_err());
        assert_eq!(rgb("0.5"), Ok([0.5; 3]));
        assert_eq!(spectrum_samples("400:1, 500:2"), Ok(vec![(400.0, 1.0), (500.0, 2.0)]));
        assert!(spectrum_samples("500:1, 400:2").is_err() && spectrum_samples("400:1 3").is_err());
        assert_eq!(spectrum_file("# comment\n400 1\n\n500 2 # end\n"), Ok(vec![(400.0, 1.0), (500.0, 2.0)]));
    }
}
