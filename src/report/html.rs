//! The report for people: one page without anything from elsewhere.

use std::fmt::Write;

use super::experiment::Experiment;
use super::picture::{data_uri, error_pictures};
use super::reference::CLAIM_FACTOR;
use super::series::{Outcome, Series, THRESHOLDS};
use super::stats::Interval;
use super::table;

const STYLE: &str = include_str!("style.css");

/// A series under its name with what it came to.
struct Entry<'e> {
    label: String,
    series: &'e Series,
    outcome: Outcome,
}

/// The whole page.
pub fn page(e: &Experiment, plots: &[(&'static str, String)], exposure: f32) -> String {
    let several = e.several_backends();
    let entry = |s: &'_ Series| Some((s.label(several), s.outcome(&e.reference)?));
    let entries: Vec<Entry> = e
        .series
        .iter()
        .filter_map(|series| entry(series).map(|(label, outcome)| Entry { label, series, outcome }))
        .collect();
    let mut body = String::new();
    body += &head(e, &entries);
    body += "<h2>Error against cost</h2><p>The line is the median over the seeds, the band reaches from the lower to the \
             upper quartile. Both axes are logarithmic: a method without bias falls by a decade in each decade, a biased one \
             levels out. Lower and further left is better.</p><div class=\"plots\">";
    for (_, svg) in plots {
        write!(body, "<figure>{svg}</figure>").expect("strings take all that is written");
    }
    body += "</div>";
    body += &equal_time(&entries);
    body += &equal_error(&entries);
    body += &pictures(e, &entries, exposure);
    body += &noise_and_bias(e, &entries);
    body += &slopes(&entries);
    body += &circumstances(e, &entries);
    let title = escape(&format!("Error against run time: {}", e.scene));
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <link rel=\"icon\" href=\"data:,\"><title>{title}</title><style>\n{STYLE}</style></head>\n<body>{body}</body></html>\n"
    )
}

/// Title, the verdict in a sentence, and what to be careful about.
fn head(e: &Experiment, entries: &[Entry]) -> String {
    let mut text = format!("<h1>Error against run time: {}</h1>", escape(&e.scene));
    let error = |x: &Entry| x.outcome.metrics[1].1.map_or(f64::NAN, |m| m[0]);
    let best = entries.iter().filter(|x| error(x).is_finite()).min_by(|a, b| error(a).total_cmp(&error(b)));
    if let Some(best) = best {
        let others: Vec<String> = entries
            .iter()
            .filter(|x| x.label != best.label && error(x).is_finite() && error(best) > 0.0)
            .map(|x| format!("{} times that of {}", number(error(best) / error(x)), escape(&x.label)))
            .collect();
        let compared = if others.is_empty() { String::new() } else { format!(", {}", others.join(" and ")) };
        let what = match e.budget.passes {
            Some(n) => format!("After {n} passes"),
            None => format!("After {}", seconds(e.budget.seconds)),
        };
        write!(
            text,
            "<p class=\"verdict\">{what}, <b>{}</b> is closest to the reference: relMSE {}{compared}.</p>",
            escape(&best.label),
            number(error(best))
        )
        .expect("strings take all that is written");
    } else {
        text += "<p class=\"verdict\">Nothing has been measured yet.</p>";
    }
    for w in warnings(e, entries) {
        write!(text, "<p class=\"warn\">{}</p>", escape(&w)).expect("strings take all that is written");
    }
    text
}

/// What a reader must know before believing the figures.
fn warnings(e: &Experiment, entries: &[Entry]) -> Vec<String> {
    let mut all = e.warnings.clone();
    if !e.finished {
        let made: usize = e.series.iter().map(|s| s.runs.iter().filter(|r| r.finished).count()).sum();
        all.push(format!("Not finished: {made} runs were made to their end. What is here is right as far as it goes."));
    }
    if e.reference.black {
        all.push(
            "The reference is black. Either no light of the scene reaches the camera or it is the wrong file; relative \
             errors mean nothing here."
                .to_owned(),
        );
    }
    if e.width * e.height == 1 {
        all.push("The picture has one pixel: all metrics are of that pixel, and none is trimmed.".to_owned());
    }
    match e.reference.relmse {
        None => all.push(
            "The reference does not say how good it is. Errors may be its own; `caustica reference` makes one that says."
                .to_owned(),
        ),
        Some(own) if entries.iter().any(|x| x.outcome.hidden) => all.push(format!(
            "Some errors are less than {CLAIM_FACTOR:.0} times the reference's own relMSE of {own:.1e}: in the grey part of the plots \
             and where marked with ≲, the methods may be better than they look. A better reference takes more time."
        )),
        Some(_) => {}
    }
    if e.reference.same_scene.is_none() {
        all.push("The reference does not say which scene it shows; it was taken on trust.".to_owned());
    }
    if e.machine.busy() {
        all.push(format!(
            "The machine had other work (load {:.1} before the start, {} processors): compare processor times, and take \
             wall-clock times as upper bounds.",
            e.machine.load.unwrap_or(0.0),
            e.machine.processors
        ));
    }
    for x in entries {
        if let Some(s) = x.outcome.split.filter(|s| s.bias_sq > 0.5 * s.relmse && s.relmse > 0.0) {
            all.push(format!(
                "{}: {:.0} % of the error that is left is bias, which more time will not remove: the method's own, light that \
                 it cannot find, or a reference of another scene.",
                x.label,
                100.0 * (s.bias_sq / s.relmse).min(1.0)
            ));
        }
    }
    all
}

fn equal_time(entries: &[Entry]) -> String {
    let mut text = "<h2>At equal time</h2><p>Medians over the seeds at the end of each run. In grey: the same metric without the 0.1 % of \
         pixels that have the largest error, and the share of the error that they hold. The best is marked ★.</p>\
         <div class=\"scroll\"><table><tr><th>method</th><th>seconds</th><th>passes</th><th>rays</th><th>photon paths</th>"
        .to_owned();
    let names: Vec<&str> = entries.first().map(|x| x.outcome.metrics.iter().map(|m| m.0).collect()).unwrap_or_default();
    for name in &names {
        write!(text, "<th>{name}</th>").expect("strings take all that is written");
    }
    text += "<th>1/(relMSE·s)</th></tr>";
    let value = |x: &Entry, k: usize| x.outcome.metrics[k].1.map(|m| m[0]);
    let best = |k: usize| entries.iter().filter_map(|x| value(x, k)).fold(f64::INFINITY, f64::min);
    for x in entries {
        let o = &x.outcome;
        write!(
            text,
            "<tr><td>{}</td><td>{:.2}</td><td>{:.0}</td><td>{}</td><td>{}</td>",
            escape(&x.label),
            o.seconds,
            o.passes,
            large(o.rays),
            large(o.photons)
        )
        .expect("strings take all that is written");
        for (k, (_, metric)) in o.metrics.iter().enumerate() {
            let Some([plain, trimmed, energy]) = *metric else {
                text += "<td>undefined</td>";
                continue;
            };
            let class = if entries.len() > 1 && plain <= best(k) { " class=\"best\"" } else { "" };
            let hidden = if k == 1 && o.hidden { "≲ " } else { "" };
            write!(
                text,
                "<td><span{class}>{hidden}{}</span><br><span class=\"dim\">{} · {:.0} %</span></td>",
                number(plain),
                number(trimmed),
                100.0 * energy
            )
            .expect("strings take all that is written");
        }
        write!(text, "<td>{}</td></tr>", o.merit.map_or("–".to_owned(), number))
            .expect("strings take all that is written");
    }
    text + "</table></div>"
}

fn equal_error(entries: &[Entry]) -> String {
    let mut text = "<h2>At equal error</h2><p>Time and rays until relMSE first falls to a value: medians over the seeds, read \
                    between snapshots on straight lines through the logarithms. A dash: fewer than half of the seeds got \
                    there.</p><div class=\"scroll\"><table><tr><th>method</th>"
        .to_owned();
    for t in THRESHOLDS {
        write!(text, "<th>relMSE {t}</th><th>rays</th>").expect("strings take all that is written");
    }
    text += "</tr>";
    for x in entries {
        write!(text, "<tr><td>{}</td>", escape(&x.label)).expect("strings take all that is written");
        for (k, r) in x.outcome.reached.iter().enumerate() {
            let best = entries.iter().filter_map(|y| y.outcome.reached[k].seconds).fold(f64::INFINITY, f64::min);
            let time = r.seconds.map_or("–".to_owned(), |s| {
                let class = if entries.len() > 1 && s <= best { " class=\"best\"" } else { "" };
                format!("<span{class}>{}{}</span>", if r.at_once { "≤ " } else { "" }, seconds(s))
            });
            write!(text, "<td>{time}</td><td>{}</td>", r.rays.map_or("–".to_owned(), large))
                .expect("strings take all that is written");
        }
        text += "</tr>";
    }
    text + "</table></div>"
}

fn pictures(e: &Experiment, entries: &[Entry], exposure: f32) -> String {
    let figure = |image: Option<String>, caption: String, name: &str| {
        image.map_or_else(String::new, |uri| {
            format!("<figure><img alt=\"{}\" src=\"{uri}\"><figcaption>{caption}</figcaption></figure>", escape(name))
        })
    };
    let caption = |x: &Entry| {
        let last = x.series.runs.first().and_then(|r| r.snapshots.last());
        last.map_or_else(String::new, |s| {
            format!("<b>{}</b>, {}, relMSE {}", escape(&x.label), seconds(s.seconds), number(s.error.relmse.value))
        })
    };
    let mut text = "<h2>Pictures at equal time</h2><p>The first seed.</p><div class=\"strip\">".to_owned();
    text += &figure(data_uri(&e.reference.image, exposure), "<b>reference</b>".to_owned(), "the reference");
    for x in entries {
        let picture = x.series.picture.as_ref().and_then(|p| data_uri(p, exposure));
        text += &figure(picture, caption(x), &format!("picture by {}", x.label));
    }
    let (maps, (low, high)) = error_pictures(e);
    write!(
        text,
        "</div><h2>Where the error is</h2><p>Error of each pixel relative to the reference, √((x−r)²/(r²+0.01²)), mean of the \
         channels inside the root; one logarithmic scale from {} (dark violet) to {} (yellow) for all.</p><div class=\"strip\">",
        number(low),
        number(high)
    )
    .expect("strings take all that is written");
    let shown = e.series.iter().zip(maps).filter(|(s, _)| s.picture.is_some());
    for (series, map) in shown {
        let label = series.label(e.several_backends());
        let uri = map.and_then(|m| data_uri(&m, 0.0));
        text += &figure(uri, format!("<b>{}</b>", escape(&label)), &format!("error of {label} in false colour"));
    }
    text + "</div>"
}

fn noise_and_bias(e: &Experiment, entries: &[Entry]) -> String {
    let mut text = "<h2>Noise and bias</h2><p>relMSE as the sum of the variance of one run, told from how far the seeds lie \
                    apart, and of squared bias, the rest less the reference's own variance. Squared bias is itself measured \
                    and may come out below zero where there is none; with few seeds it is rough.</p>"
        .to_owned();
    if entries.iter().all(|x| x.outcome.split.is_none()) {
        return text + "<p>It takes two seeds.</p>";
    }
    text += "<div class=\"scroll\"><table><tr><th>method</th><th>seconds</th><th>passes</th><th>seeds</th><th>relMSE</th>\
             <th>variance</th><th>bias²</th><th>bias² share</th></tr>";
    for x in entries {
        let splits = x.series.splits(&e.reference);
        // Four moments tell the trend.
        let step = splits.len().div_ceil(4).max(1);
        for s in splits.iter().rev().step_by(step).collect::<Vec<_>>().into_iter().rev() {
            write!(
                text,
                "<tr><td>{}</td><td>{:.2}</td><td>{:.0}{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1} %</td></tr>",
                escape(&x.label),
                s.seconds,
                s.passes,
                if s.at_end { " (end)" } else { "" },
                s.seeds,
                number(s.relmse),
                number(s.variance),
                number(s.bias_sq),
                100.0 * s.bias_sq / s.relmse.max(1e-300)
            )
            .expect("strings take all that is written");
        }
    }
    text + "</table></div>"
}

fn slopes(entries: &[Entry]) -> String {
    let mut text = "<h2>Slopes</h2><p>Exponent b of relMSE ∝ Nᵇ, fitted to the last decade of passes of each seed: mean over \
                    the seeds and its 95 % interval (Student's t). Unbiased methods have −1, or less with stratified samples; \
                    progressive photon mapping has −2/3 for α = 2/3.</p><div class=\"scroll\"><table><tr><th>method</th>\
                    <th>against passes</th><th>against seconds</th></tr>"
        .to_owned();
    let shown = |i: &Option<Interval>| match i {
        Some(Interval { mean, half_width: Some(h) }) => format!("{mean:.3} ± {h:.3}"),
        Some(Interval { mean, half_width: None }) => format!("{mean:.3} (one seed)"),
        None => "too few snapshots".to_owned(),
    };
    for x in entries {
        let (a, b) = (shown(&x.outcome.slope), shown(&x.outcome.time_slope));
        write!(text, "<tr><td>{}</td><td>{a}</td><td>{b}</td></tr>", escape(&x.label))
            .expect("strings take all that is written");
    }
    text + "</table></div>"
}

/// How it was measured.
fn circumstances(e: &Experiment, entries: &[Entry]) -> String {
    let m = &e.machine;
    let r = &e.reference;
    let mut text = format!(
        "<h2>How this was measured</h2><ul>\
         <li>Scene {}, {} × {} pixels, {} triangles, hash <code>{}</code>.</li>\
         <li>{} seeds; the seed changes last, so that all methods meet the machine in the same state.</li>\
         <li>Time is wall-clock time from the start of a run: it counts building the tree for ray queries and photon maps. It \
         does not count reading the scene ({:.2} s once), taking and measuring snapshots, or writing this report.</li>\
         <li>Snapshots stand where the number of passes has grown by a factor of 1.26, so that the error at a number of passes \
         is the same in every repetition; at the end there is one more.</li>\
         <li>{}, {} threads of {} processors; threads are not pinned, and clock rates are the system's.</li>\
         <li>caustica {}, commit {}.</li>",
        escape(&e.scene),
        e.width,
        e.height,
        large(e.triangles as f64),
        escape(&e.scene_hash),
        e.seeds,
        e.load_seconds,
        escape(&m.cpu),
        m.threads,
        m.processors,
        m.version,
        escape(m.commit)
    );
    write!(
        text,
        "<li>Reference: {}{}{}; own error {}.</li></ul>",
        escape(&r.source),
        r.methods.as_ref().map_or_else(String::new, |m| format!(", methods {}", escape(m))),
        r.seeds.as_ref().map_or_else(String::new, |s| format!(", seeds {}", escape(s))),
        r.relmse.map_or("unknown".to_owned(), |v| format!("relMSE {}", number(v))),
    )
    .expect("strings take all that is written");
    text += &overhead(entries);
    text += "<details><summary>Parameters of the methods</summary><ul>";
    for x in entries {
        write!(
            text,
            "<li><b>{}</b> ({}): {}</li>",
            escape(&x.series.method),
            escape(&x.series.accel),
            escape(&x.series.parameters)
        )
        .expect("strings take all that is written");
    }
    text += "</ul></details><details><summary>Columns of convergence.csv, one row for each snapshot</summary>\
             <div class=\"scroll\"><table><tr><th>column</th><th>meaning</th></tr>";
    for (name, meaning) in table::columns() {
        write!(text, "<tr><td><code>{name}</code></td><td class=\"text\">{}</td></tr>", escape(&meaning))
            .expect("strings take all that is written");
    }
    text + "</table></div></details>"
}

/// What measuring cost, beside the methods' time and in it.
fn overhead(entries: &[Entry]) -> String {
    let mut text = "<p>What snapshots cost. While they are taken and measured the clock stands still; caches that they leave \
                    cold may still slow down the pass that follows. The last column is how much the passes after snapshots \
                    took longer than the passes after those, times the number of snapshots, over the method's time, with the \
                    95 % interval.</p><div class=\"scroll\"><table><tr><th>method</th><th>snapshots a run</th>\
                    <th>clock stopped for</th><th>added to the method's time</th></tr>"
        .to_owned();
    for x in entries {
        let o = x.outcome.overhead;
        let added = o.added.map_or("too few passes".to_owned(), |i| {
            format!("{:.2} ± {:.2} %", 100.0 * i.mean, 100.0 * i.half_width.unwrap_or(f64::INFINITY))
        });
        write!(
            text,
            "<tr><td>{}</td><td>{:.0}</td><td>{:.1} % of its time</td><td>{}</td></tr>",
            escape(&x.label),
            o.snapshots,
            100.0 * o.clock_stopped,
            added.replace('-', "−")
        )
        .expect("strings take all that is written");
    }
    text + "</table></div>"
}

/// Three significant digits, powers of ten where they are shorter.
fn number(v: f64) -> String {
    if v == 0.0 {
        return "0".to_owned();
    }
    if !v.is_finite() {
        return "–".to_owned();
    }
    let decade = v.abs().log10().floor() as i32;
    if (-3..5).contains(&decade) {
        format!("{v:.*}", (2 - decade).max(0) as usize).replace('-', "−")
    } else {
        let text = format!("{v:.2e}");
        let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        format!("{digits}·10<sup>{exponent}</sup>").replace('-', "−")
    }
}

/// `1.23 M`.
fn large(v: f64) -> String {
    match v {
        v if v >= 1e9 => format!("{:.2} G", v / 1e9),
        v if v >= 1e6 => format!("{:.2} M", v / 1e6),
        v if v >= 1e4 => format!("{:.1} k", v / 1e3),
        v => format!("{v:.0}"),
    }
}

fn seconds(v: f64) -> String {
    match v {
        v if v >= 100.0 => format!("{v:.0} s"),
        v if v >= 1.0 => format!("{} s", (100.0 * v).round() / 100.0),
        v => format!("{:.0} ms", 1e3 * v),
    }
}

/// Text that stands for itself in HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let found = [0.0, 1.0, 0.012_34, 123.4, 1.5e-7, -2e6, f64::NAN].map(number);
        assert_eq!(found, ["0", "1.00", "0.0123", "123", "1.50·10<sup>−7</sup>", "−2.00·10<sup>6</sup>", "–"]);
        assert_eq!([0.25, 1.0, 2.5, 60.0, 1234.5].map(seconds), ["250 ms", "1 s", "2.5 s", "60 s", "1234 s"]);
        assert_eq!([7.0, 12_345.0, 2.5e6, 3e9].map(large), ["7", "12.3 k", "2.50 M", "3.00 G"]);
        assert_eq!(escape("<a & \"b\">"), "&lt;a &amp; &quot;b&quot;&gt;");
    }
}
