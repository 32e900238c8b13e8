use super::*;
use crate::color::Rgb;
use crate::image::compare;
use crate::sample::hash_u64;

const REFERENCE: f32 = 2.0;

fn reference(pixels: u32) -> Reference {
    Reference {
        image: Image::constant(pixels, 1, Rgb::splat(REFERENCE)),
        source: String::new(),
        methods: None,
        seeds: None,
        mse: Some(0.0),
        relmse: Some(0.0),
        same_scene: Some(true),
        black: false,
    }
}

/// A snapshot of `image`; a pass takes a tenth of a second and a thousand rays, building took a second.
fn snapshot(passes: u64, image: &Image, reference: &Reference, last: bool) -> Snapshot {
    Snapshot {
        passes,
        spp: passes,
        seconds: 1.0 + 0.1 * passes as f64,
        cpu_seconds: None,
        rays: 1000 * passes,
        photons: 0,
        regular: true,
        last,
        hidden: false,
        error: compare(image, &reference.image).expect("images of one size"),
    }
}

/// An image whose relMSE is `error`.
fn off_by(error: f64) -> Image {
    let r = f64::from(REFERENCE);
    Image::constant(1, 1, Rgb::splat((r + (error * (r * r + RELMSE_EPSILON * RELMSE_EPSILON)).sqrt()) as f32))
}

fn series(error: impl Fn(u64, u64) -> f64) -> (Series, Reference) {
    let reference = reference(1);
    let mut series = Series::new("path".into(), "tree".into(), String::new());
    for seed in 0..5 {
        let mut run = Run { finished: true, ..Run::empty(seed, 1.0) };
        let mut passes = 1;
        while passes < 500 {
            run.snapshots.push(snapshot(passes, &off_by(error(seed, passes)), &reference, false));
            passes = super::super::run::next_due(passes);
        }
        series.runs.push(run);
    }
    (series, reference)
}

/// relMSE = 0.8·spread/N with spread 0.5, 0.75, 1, 1.25, 1.5 over the seeds.
#[test]
fn curves_slopes_and_crossings_of_known_errors() {
    let (s, r) = series(|seed, n| 0.8 * (0.5 + 0.25 * seed as f64) / n as f64);
    let curve = s.curve();
    let first = curve[0];
    assert_eq!((first.passes, first.seeds), (1, 5));
    assert!((first.seconds - 1.1).abs() < 1e-9 && first.rays == 1000.0);
    for (found, expected) in first.relmse.into_iter().zip([0.6, 0.8, 1.0]) {
        assert!((found - expected).abs() < 1e-4, "{:?}", first.relmse);
    }
    let o = s.outcome(&r).expect("snapshots");
    let slope = o.slope.expect("enough points");
    assert!((slope.mean + 1.0).abs() < 1e-3 && slope.half_width.expect("five seeds") < 1e-3, "{slope:?}");
    // The constant second of building flattens the slope against time.
    assert!(o.time_slope.expect("enough points").mean < slope.mean);
    // Seeds reach 0.1 at N = 4, 6, 8, 10, 12; the median is 8 passes, and 0.01 takes ten times as many.
    assert!((o.reached[0].rays.expect("reached") / 8000.0 - 1.0).abs() < 0.01, "{:?}", o.reached);
    assert!((o.reached[1].rays.expect("reached") / 80_000.0 - 1.0).abs() < 0.01, "{:?}", o.reached);
    assert!(o.reached[2].seconds.is_none() && !o.reached[0].at_once);
}

/// Passes after two snapshots took 1 and 3 ms longer than those that followed, and every snapshot is taken to cost the mean.
#[test]
fn the_cost_of_snapshots_is_told() {
    let (mut s, r) = series(|_, n| 0.8 / n as f64);
    assert_eq!(s.outcome(&r).expect("snapshots").overhead.added, None);
    for run in &mut s.runs {
        run.snapshot_seconds = 0.5;
        run.slower_after = vec![0.001, 0.003];
    }
    let o = s.outcome(&r).expect("snapshots").overhead;
    let last = s.runs[0].snapshots.last().expect("snapshots");
    let (n, seconds) = (s.runs[0].snapshots.len() as f64, last.seconds);
    assert!(o.snapshots == n && (o.clock_stopped - 0.5 / seconds).abs() < 1e-12, "{o:?}");
    let added = o.added.expect("ten pairs");
    assert!((added.mean - n * 0.002 / seconds).abs() < 1e-12, "{o:?}");
    // Ten values one standard deviation of 1.054 ms apart: t = 2.262 with nine degrees of freedom.
    let half = 2.262_16 * n * 0.001_054_09 / 10f64.sqrt() / seconds;
    assert!((added.half_width.expect("ten pairs") / half - 1.0).abs() < 1e-4, "{o:?}");
}

#[test]
fn what_the_reference_cannot_tell_is_left_out_of_slopes() {
    let (mut s, r) = series(|_, n| 0.8 / n as f64 + 0.01);
    let flat = s.outcome(&r).expect("snapshots").slope.expect("points").mean;
    for x in s.runs.iter_mut().flat_map(|r| &mut r.snapshots).filter(|x| x.passes > 8) {
        x.hidden = true;
    }
    let steep = s.outcome(&r).expect("snapshots").slope.expect("points").mean;
    assert!(flat > -0.7 && steep < -0.9, "{flat} {steep}");
}

/// Pixels r + b + σ·n with bias b and unit-variance n: relMSE splits into σ²/(r²+ε²) and b²/(r²+ε²). 3 × 2000 values of
/// 4 seeds tell σ² to a standard error of 1 %, b² to 0.2 % of σ²; the test allows five of each.
#[test]
fn noise_and_bias_are_told_apart() {
    let pixels = 2000;
    let reference = reference(pixels);
    let (sigma, bias) = (0.2f64, 0.1f64);
    let normal =
        |seed: u64, i: u64| (0..12).map(|k| hash_u64(seed, 12 * i + k) as f64 / u64::MAX as f64).sum::<f64>() - 6.0;
    let mut series = Series::new("photonmapper".into(), "tree".into(), String::new());
    for seed in 0..4 {
        let image = Image::from_fn(pixels, 1, |x, _| {
            let value = |c: u64| f64::from(REFERENCE) + bias + sigma * normal(seed, 3 * u64::from(x) + c);
            Rgb::from([0, 1, 2].map(|c| value(c) as f32))
        });
        let s = snapshot(8, &image, &reference, true);
        series.add_picture(&s, &image, seed == 0);
        series.runs.push(Run { snapshots: vec![s], ..Run::empty(seed, 0.0) });
    }
    let splits = series.splits(&reference);
    assert_eq!(splits.len(), 2);
    for s in splits {
        let (variance, bias_sq) = (sigma * sigma, bias * bias);
        assert!((s.mse_variance / variance - 1.0).abs() < 0.05, "{s:?}");
        assert!((s.mse_bias_sq - bias_sq).abs() < 0.01 * variance, "{s:?}");
        let weight = f64::from(REFERENCE).powi(2) + RELMSE_EPSILON.powi(2);
        assert!((s.variance * weight / s.mse_variance - 1.0).abs() < 1e-3, "{s:?}");
        assert_eq!(s.seeds, 4);
    }
}
