//! `correlation_aware` weights of `vcm`: less variance where merges share camera paths, the same mean.

mod common;

use std::path::Path;

use caustica::image::Image;
use caustica::render::PlanOverrides;
use caustica::scene::{LoadOptions, Scene};
use common::{Estimate, run};

/// SmallVCM's box under a point light, small: radii follow from the pixels and are large.
fn room(switches: &str) -> Result<Scene, String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/smallvcm/point.xml");
    let text = std::fs::read_to_string(&path).expect("the scene is there");
    let text = text.replace(r#"<integrator type="vcm">"#, &format!(r#"<integrator type="vcm">{switches}"#));
    let defines = [("width", "32"), ("height", "32")].map(|(k, v)| (k.to_owned(), v.to_owned())).to_vec();
    Scene::from_text(&text, &path, &LoadOptions { defines, ..LoadOptions::default() }).map_err(|e| e.to_string())
}

fn switch(name: &str, on: bool) -> String {
    format!(r#"<boolean name="{name}" value="{on}"/>"#)
}

fn pictures(aware: bool) -> Vec<Image> {
    let s = room(&(switch("merge_all", true) + &switch("correlation_aware", aware))).expect("a good scene");
    let one = |seed| run(&s, PlanOverrides { seed: Some(seed), spp: Some(2), ..PlanOverrides::default() }).image;
    (1..=16).map(one).collect()
}

/// The mean is off by 0.2 % at most, which merging blurs, and four standard errors: Student's t with 30 degrees of freedom at
/// 99.96 %. Of eight pairs of pictures the logarithms of the ratio of squared differences must be below 0, by Student's t with
/// 7 degrees of freedom at 99.9 % on one side.
#[test]
fn the_mean_stays_and_the_variance_falls() {
    let (plain, aware) = (pictures(false), pictures(true));
    let mean = |images: &[Image]| {
        Estimate::of(
            images
                .iter()
                .map(|i| i.pixels().iter().map(|p| f64::from(p.mean())).sum::<f64>() / i.pixels().len() as f64),
        )
    };
    let (a, b) = (mean(&plain), mean(&aware));
    let error = (a.error.powi(2) + b.error.powi(2)).sqrt();
    assert!((a.mean - b.mean).abs() < 0.002 * a.mean + 4.0 * error, "{a:?} {b:?}");
    let apart = |pair: &[Image]| {
        let of = |(a, b): (&caustica::color::Rgb, &caustica::color::Rgb)| {
            let (a, b) = (f64::from(a.mean()), f64::from(b.mean()));
            (a - b).powi(2) / (0.25 * (a + b).powi(2) + 1e-4)
        };
        pair[0].pixels().iter().zip(pair[1].pixels()).map(of).sum::<f64>()
    };
    let logs = Estimate::of(plain.chunks(2).zip(aware.chunks(2)).map(|(p, a)| (apart(a) / apart(p)).ln()));
    println!("variance {:.3} of the balance heuristic's", logs.mean.exp());
    assert!(logs.mean + 4.785 * logs.error < 0.0, "{logs:?}");
}

#[test]
fn without_merging_it_makes_no_sense() {
    let both = switch("merge", false) + &switch("correlation_aware", true);
    let error = room(&both).err().expect("a mistake");
    assert!(error.contains("without merging") && error.contains("leave one of the two out"), "{error}");
    assert!(room(&(both + &switch("merge_all", true))).is_ok(), "merge_all merges all the same");
    let bdpt = switch("correlation_aware", true);
    assert!(room(&bdpt).is_ok());
}
