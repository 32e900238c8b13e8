//! Values of options that have a form of their own. What is wrong is said with what was expected.

use std::ops::Range;
use std::time::Duration;

use crate::scene::{Item, NeedOverride};

/// `2000000`, `500k`, `2M`, `1.5M`; at most 400 million, which fit 32-bit indices.
pub fn count(s: &str) -> Result<u64, String> {
    let expected = || format!("found {s:?}, expected a number from 1 to 400M, for example 2000000, 500k or 2M");
    let (number, unit) = match s.strip_suffix(['k', 'K', 'm', 'M']) {
        Some(n) => (n, if s.ends_with(['k', 'K']) { 1e3 } else { 1e6 }),
        None => (s, 1.0),
    };
    let n = number.parse::<f64>().map_err(|_| expected())? * unit;
    if (1.0..=4e8).contains(&n) { Ok(n.round() as u64) } else { Err(expected()) }
}

/// A number above zero.
pub fn positive(s: &str) -> Result<f32, String> {
    s.parse()
        .ok()
        .filter(|v: &f32| v.is_finite() && *v > 0.0)
        .ok_or_else(|| format!("found {s:?}, expected a number above 0"))
}

/// `512MB`, `2GB`, `64k`, `1GiB`.
pub fn bytes(s: &str) -> Result<u64, String> {
    let expected = || format!("found {s:?}, expected a number of bytes, for example 512MB or 2GB");
    let digits = s.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(s.len());
    let (number, unit) = s.split_at(digits);
    let scale = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kb" => 1e3,
        "m" | "mb" => 1e6,
        "g" | "gb" => 1e9,
        "kib" => 1024.0,
        "mib" => 1024.0 * 1024.0,
        "gib" => 1024.0 * 1024.0 * 1024.0,
        _ => return Err(expected()),
    };
    let n = number.parse::<f64>().map_err(|_| expected())? * scale;
    if (1e3..=1e15).contains(&n) { Ok(n as u64) } else { Err(expected()) }
}

pub fn key_value(s: &str) -> Result<(String, String), String> {
    match s.split_once('=') {
        Some((k, v)) if !k.is_empty() => Ok((k.to_owned(), v.to_owned())),
        _ => Err(format!("found {s:?}, expected KEY=VALUE, for example -D spp=64")),
    }
}

/// `caustics=off`.
pub fn need(s: &str) -> Result<NeedOverride, String> {
    let (item, on) = match s.split_once('=') {
        Some((item, "on")) => (item, true),
        Some((item, "off")) => (item, false),
        _ => return Err(format!("found {s:?}, expected ITEM=on or ITEM=off, for example --need caustics=off")),
    };
    let item: Item = item.parse()?;
    if on && !item.is_built() {
        return Err(format!("found {s:?}, but this version cannot make it"));
    }
    Ok((item, on))
}

/// `relmse=1e-3`.
pub fn target_error(s: &str) -> Result<f64, String> {
    let value = s.strip_prefix("relmse=").and_then(|v| v.parse::<f64>().ok());
    value.filter(|v| *v > 0.0 && v.is_finite()).ok_or_else(|| {
        format!("found {s:?}, expected relmse= and a positive number, for example --target-error relmse=1e-3")
    })
}

/// `0..64`
pub fn range(s: &str) -> Result<Range<u64>, String> {
    let expected = || format!("found {s:?}, expected two pass numbers, the second not included, for example 0..64");
    let (from, to) = s.split_once("..").ok_or_else(expected)?;
    let range = from.parse().map_err(|_| expected())?..to.parse().map_err(|_| expected())?;
    if range.is_empty() { Err(expected()) } else { Ok(range) }
}

/// `90`, `90s`, `1.5min`, `2h`, `500ms`.
pub fn duration(s: &str) -> Result<Duration, String> {
    let expected = || format!("found {s:?}, expected a number with ms, s, min or h behind it, for example 30s");
    let split = s.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(s.len());
    let (number, unit) = s.split_at(split);
    let number: f64 = number.parse().map_err(|_| expected())?;
    let seconds = match unit.trim() {
        "ms" => 1e-3,
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(expected()),
    };
    Duration::try_from_secs_f64(number * seconds).map_err(|_| expected())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts() {
        assert_eq!(count("2M"), Ok(2_000_000));
        assert_eq!(count("1.5k"), Ok(1500));
        assert_eq!(count("17"), Ok(17));
        assert!(count("0").is_err() && count("1G").is_err() && count("-3").is_err() && count("NaN").is_err());
    }

    #[test]
    fn needs() {
        assert_eq!(need("caustics=off"), Ok((Item::Caustics, false)));
        assert_eq!(need("uv=on"), Ok((Item::Uv, true)));
        assert_eq!(need("spectral=off"), Ok((Item::Spectral, false)));
        assert!(need("spectral=on").is_err_and(|e| e.contains("cannot make")));
        assert!(need("caustics").is_err() && need("caustics=yes").is_err() && need("caustic=on").is_err());
    }

    #[test]
    fn byte_counts() {
        assert_eq!(bytes("512MB"), Ok(512_000_000));
        assert_eq!(bytes("1.5GiB"), Ok(3 << 29));
        assert_eq!(bytes("4096"), Ok(4096));
        assert!(bytes("12").is_err() && bytes("MB").is_err() && bytes("-1MB").is_err() && bytes("1 TB").is_err());
    }

    #[test]
    fn target_errors() {
        assert_eq!(target_error("relmse=1e-3"), Ok(1e-3));
        for wrong in ["1e-3", "rmse=1", "relmse=", "relmse=0", "relmse=-1", "relmse=inf", "relmse=NaN"] {
            assert!(target_error(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn ranges() {
        assert_eq!(range("0..64"), Ok(0..64));
        assert!(range("64").is_err() && range("3..3").is_err() && range("..4").is_err() && range("-1..4").is_err());
    }

    #[test]
    fn durations() {
        assert_eq!(duration("30s"), Ok(Duration::from_secs(30)));
        assert_eq!(duration("1.5min"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("250ms"), Ok(Duration::from_millis(250)));
        assert!(duration("soon").is_err() && duration("1 day").is_err() && duration("").is_err());
    }
}
