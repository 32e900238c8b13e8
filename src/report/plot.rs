//! Curves of error over cost on logarithmic axes, as SVG.
//!
//! Colours are those of Okabe and Ito, which colour-blind people can tell apart; every method also has its own marker, and
//! back ends differ by dashes, so that grey print does as well.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::experiment::Experiment;
use super::series::Point;

/// Pixels of a plot; text is as large as it must be to be read on a phone.
const SIZE: (u32, u32) = (560, 440);
const TEXT: u32 = 15;

const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(120, 94, 40),
];
const GRID: RGBColor = RGBColor(222, 222, 222);
const INK: RGBColor = RGBColor(40, 40, 40);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// The file name and SVG of every plot.
pub fn all(experiment: &Experiment) -> Vec<(&'static str, String)> {
    let floor = experiment.reference.relmse.map(|e| e * super::reference::CLAIM_FACTOR);
    let seconds = |p: &Point| p.seconds;
    let flat = |f: fn(&Point) -> f64| move |p: &Point| [f(p); 3];
    vec![
        (
            "error-time.svg",
            plot(experiment, "relMSE against time", "seconds", "relMSE", &seconds, &|p| p.relmse, floor),
        ),
        (
            "error-rays.svg",
            plot(experiment, "relMSE against rays", "rays", "relMSE", &|p| p.rays, &|p| p.relmse, floor),
        ),
        (
            "trimmed-time.svg",
            plot(
                experiment,
                "relMSE without the worst 0.1 %",
                "seconds",
                "trimmed relMSE",
                &seconds,
                &flat(|p| p.relmse_trimmed),
                None,
            ),
        ),
        (
            "flip-time.svg",
            plot(experiment, "ꟻLIP against time", "seconds", "mean ꟻLIP", &seconds, &flat(|p| p.flip), None),
        ),
    ]
}

/// The points of a series as logarithms: abscissa, lower quartile, median, upper quartile.
type Logs = Vec<(f64, [f64; 3])>;

fn plot(
    experiment: &Experiment,
    title: &str,
    x_name: &str,
    y_name: &str,
    x: &dyn Fn(&Point) -> f64,
    y: &dyn Fn(&Point) -> [f64; 3],
    floor: Option<f64>,
) -> String {
    let logs = |p: &Point| (x(p).log10(), y(p).map(f64::log10));
    let finite = |p: &(f64, [f64; 3])| p.0.is_finite() && p.1.iter().all(|v| v.is_finite());
    let curves: Vec<Logs> =
        experiment.series.iter().map(|s| s.curve().iter().map(logs).filter(finite).collect()).collect();
    let several = experiment.several_backends();
    let labels: Vec<String> = experiment.series.iter().map(|s| s.label(several)).collect();
    let styles = styles(experiment);
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let plot = Plot { title, x_name, y_name, floor: floor.map(f64::log10).filter(|f| f.is_finite()) };
        plot.draw(&area, &curves, &labels, &styles)
            .and_then(|()| Ok(area.present()?))
            .expect("strings take all drawings");
    }
    accessible(&svg, title)
}

/// Colour, marker and dash of each series: by method, and by back end.
fn styles(experiment: &Experiment) -> Vec<(usize, bool)> {
    let mut methods: Vec<&str> = Vec::new();
    let pairs = experiment.series.iter().map(|s| (s.method.as_str(), s.accel != experiment.series[0].accel));
    pairs
        .into_iter()
        .map(|(method, dashed)| {
            let index = methods.iter().position(|m| *m == method).unwrap_or_else(|| {
                methods.push(method);
                methods.len() - 1
            });
            (index, dashed)
        })
        .collect()
}

/// Lets the picture take the width of the page, and tells readers of the page's text what it is.
fn accessible(svg: &str, title: &str) -> String {
    let (w, h) = SIZE;
    let fixed = format!("width=\"{w}\" height=\"{h}\" ");
    svg.replacen(&fixed, "role=\"img\" ", 1)
        .replacen('>', &format!("><title>{title}</title>"), 1)
        .replace("sans-serif", "system-ui, sans-serif")
}

struct Plot<'t> {
    title: &'t str,
    x_name: &'t str,
    y_name: &'t str,
    /// The error below which the reference tells nothing.
    floor: Option<f64>,
}

impl Plot<'_> {
    fn draw(&self, area: &Area, curves: &[Logs], labels: &[String], styles: &[(usize, bool)]) -> Drawn {
        area.fill(&WHITE)?;
        let text = ("sans-serif", TEXT).into_font().color(&INK);
        if curves.iter().all(Vec::is_empty) {
            area.draw(&Text::new("No error above zero was measured.", (30, 30), text))?;
            return Ok(());
        }
        // Whole decades cost room: end the axes at a third of one.
        let thirds = |v: f64, up: bool| if up { (3.0 * v).ceil() / 3.0 } else { (3.0 * v).floor() / 3.0 };
        let range = |values: Vec<f64>| {
            let low = thirds(values.iter().copied().fold(f64::INFINITY, f64::min), false);
            let high = thirds(values.iter().copied().fold(f64::NEG_INFINITY, f64::max), true);
            if high - low < 0.6 { (low - 1.0 / 3.0, high + 1.0 / 3.0) } else { (low, high) }
        };
        let xs = range(curves.iter().flatten().map(|p| p.0).collect());
        let ys = range(curves.iter().flatten().flat_map(|p| p.1).collect());
        let mut chart = ChartBuilder::on(area)
            .margin_left(62)
            .margin_right(14)
            .margin_top(34 + 20 * labels.len().div_ceil(2) as i32)
            .margin_bottom(52)
            .build_cartesian_2d(xs.0..xs.1, ys.0..ys.1)?;
        self.axes(area, &mut chart, xs, ys)?;
        if let Some(floor) = self.floor.filter(|f| (ys.0..ys.1).contains(f)) {
            let corners = [(xs.0, ys.0), (xs.1, floor)];
            chart.draw_series([Rectangle::new(corners, RGBColor(150, 150, 150).mix(0.25).filled())])?;
            let (left, top) = chart.backend_coord(&(xs.0, floor));
            let note = "below what the reference can tell";
            area.draw(&Text::new(note, (left + 6, top + 3), ("sans-serif", 12).into_font().color(&INK)))?;
        }
        for (i, curve) in curves.iter().enumerate() {
            self.curve(&mut chart, curve, styles[i])?;
        }
        // Name the curves above the plot, two in a row.
        area.draw(&Text::new(self.title, (62, 6), ("sans-serif", 17, FontStyle::Bold).into_font().color(&INK)))?;
        for (i, label) in labels.iter().enumerate() {
            let (x, y) = (62 + (i % 2) as i32 * 240, 32 + (i / 2) as i32 * 20);
            let (color, dashed) = (COLORS[styles[i].0 % COLORS.len()], styles[i].1);
            let line = color.stroke_width(3);
            if dashed {
                area.draw(&PathElement::new([(x, y + 8), (x + 10, y + 8)], line))?;
                area.draw(&PathElement::new([(x + 18, y + 8), (x + 28, y + 8)], line))?;
            } else {
                area.draw(&PathElement::new([(x, y + 8), (x + 28, y + 8)], line))?;
            }
            area.draw(&marker(styles[i].0, (x + 14, y + 8)))?;
            area.draw(&Text::new(shorten(label), (x + 36, y), text.clone()))?;
        }
        Ok(())
    }

    fn axes(&self, area: &Area, chart: &mut Chart, xs: (f64, f64), ys: (f64, f64)) -> Drawn {
        let text = ("sans-serif", TEXT).into_font().color(&INK);
        for at in ticks(xs) {
            chart.draw_series([PathElement::new([(at, ys.0), (at, ys.1)], GRID)])?;
            let (x, y) = chart.backend_coord(&(at, ys.0));
            area.draw(&Text::new(tick_label(at), (x, y + 6), text.clone().pos(Pos::new(HPos::Center, VPos::Top))))?;
        }
        for at in ticks(ys) {
            chart.draw_series([PathElement::new([(xs.0, at), (xs.1, at)], GRID)])?;
            let (x, y) = chart.backend_coord(&(xs.0, at));
            let place = Pos::new(HPos::Right, VPos::Center);
            area.draw(&Text::new(tick_label(at), (x - 6, y), text.clone().pos(place)))?;
        }
        let frame = [(xs.0, ys.1), (xs.0, ys.0), (xs.1, ys.0)];
        chart.draw_series([PathElement::new(frame, INK.stroke_width(1))])?;
        let (x, y) = (SIZE.0 as i32 / 2 + 24, SIZE.1 as i32 - 8);
        area.draw(&Text::new(self.x_name, (x, y), text.clone().pos(Pos::new(HPos::Center, VPos::Bottom))))?;
        let turned = text.transform(FontTransform::Rotate270).pos(Pos::new(HPos::Center, VPos::Top));
        area.draw(&Text::new(self.y_name, (2, SIZE.1 as i32 / 2 + 10), turned))?;
        Ok(())
    }

    fn curve(&self, chart: &mut Chart, curve: &Logs, (index, dashed): (usize, bool)) -> Drawn {
        let color = COLORS[index % COLORS.len()];
        // The band between the quartiles, then the median over it.
        let band: Vec<_> =
            curve.iter().map(|p| (p.0, p.1[2])).chain(curve.iter().rev().map(|p| (p.0, p.1[0]))).collect();
        if curve.len() > 1 {
            chart.draw_series([Polygon::new(band, color.mix(0.2))])?;
        }
        let line = curve.iter().map(|p| (p.0, p.1[1]));
        if dashed {
            chart.draw_series(DashedLineSeries::new(line, 8, 5, color.stroke_width(2)))?;
        } else {
            chart.draw_series([PathElement::new(line.collect::<Vec<_>>(), color.stroke_width(2))])?;
        }
        chart.draw_series(curve.iter().map(|p| EmptyElement::at((p.0, p.1[1])) + marker(index, (0, 0))))?;
        Ok(())
    }
}

/// The marker of a method, around a place in pixels.
fn marker(index: usize, (x, y): (i32, i32)) -> Polygon<(i32, i32)> {
    let color = COLORS[index % COLORS.len()].filled();
    let corners: &[(i32, i32)] = match index % 5 {
        0 => &[(-4, -2), (-2, -4), (2, -4), (4, -2), (4, 2), (2, 4), (-2, 4), (-4, 2)],
        1 => &[(-4, -4), (4, -4), (4, 4), (-4, 4)],
        2 => &[(0, -5), (5, 4), (-5, 4)],
        3 => &[(0, -6), (6, 0), (0, 6), (-6, 0)],
        _ => &[(0, 5), (5, -4), (-5, -4)],
    };
    Polygon::new(corners.iter().map(|c| (x + c.0, y + c.1)).collect::<Vec<_>>(), color)
}

/// Logarithms of the values to mark: powers of ten, with their double and fivefold where there are few.
fn ticks((low, high): (f64, f64)) -> Vec<f64> {
    let factors: &[f64] = match high - low {
        d if d < 2.2 => &[1.0, 2.0, 5.0],
        d if d < 3.2 => &[1.0, 3.0],
        _ => &[1.0],
    };
    let step = ((high - low) / 8.0).ceil().max(1.0) as i32;
    let decades = (low.floor() as i32..=high.ceil() as i32).filter(|d| d % step == 0);
    let all = decades.flat_map(|d| factors.iter().map(move |f| f64::from(d) + f.log10()));
    all.filter(|t| (low - 1e-9..=high + 1e-9).contains(t)).collect()
}

/// `0.01`, `20`, `5·10⁶`.
fn tick_label(log: f64) -> String {
    let decade = (log + 1e-9).floor();
    let digit = 10f64.powf(log - decade).round();
    if (-2.0..4.0).contains(&decade) {
        let places = (-decade).max(0.0) as usize;
        return format!("{:.places$}", digit * 10f64.powf(decade));
    }
    let superscript: String = format!("{decade}")
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            c => char::from_u32('⁰' as u32 + c as u32 - '0' as u32).unwrap_or(c),
        })
        .collect();
    if digit == 1.0 { format!("10{superscript}") } else { format!("{digit}·10{superscript}") }
}

/// At most as many letters as stand beside each other.
fn shorten(label: &str) -> String {
    if label.chars().count() <= 27 { label.to_owned() } else { label.chars().take(26).chain(['…']).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_stand_at_round_values() {
        let labels = |low: f64, high: f64| ticks((low, high)).into_iter().map(tick_label).collect::<Vec<_>>();
        assert_eq!(labels(-1.0, 1.0), ["0.1", "0.2", "0.5", "1", "2", "5", "10"]);
        assert_eq!(labels(-4.0, -1.0), ["10⁻⁴", "3·10⁻⁴", "10⁻³", "3·10⁻³", "0.01", "0.03", "0.1"]);
        assert_eq!(labels(5.0, 9.0), ["10⁵", "10⁶", "10⁷", "10⁸", "10⁹"]);
        assert!(ticks((-30.0, 30.0)).len() < 12);
    }
}
