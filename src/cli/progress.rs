//! Progress of a render: a bar on a terminal, plain lines elsewhere.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::render::Progress;

const STEPS: u64 = 10_000;

/// Where progress goes.
pub enum Reporter {
    Nobody,
    Bar(ProgressBar),
    Lines { last: Mutex<Instant>, started: Instant },
}

impl Reporter {
    pub fn new(quiet: bool) -> Self {
        if quiet {
            Self::Nobody
        } else if std::io::stderr().is_terminal() {
            let style = ProgressStyle::with_template("{msg:14} [{bar:32}] {percent:>3}%  {elapsed} so far, {eta} left")
                .expect("the template is a constant")
                .progress_chars("=> ");
            Self::Bar(ProgressBar::new(STEPS).with_style(style))
        } else {
            Self::Lines { last: Mutex::new(Instant::now()), started: Instant::now() }
        }
    }

    /// Names what is being done.
    pub fn say(&self, what: &str) {
        if let Self::Bar(bar) = self {
            bar.set_message(what.to_owned());
        }
    }

    pub fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Reporter {
    fn phase(&self, name: &'static str) {
        if let Self::Bar(bar) = self {
            bar.set_message(name);
        }
    }

    fn advance(&self, fraction: f64, passes: u64) {
        match self {
            Self::Nobody => {}
            Self::Bar(bar) => bar.set_position((fraction * STEPS as f64) as u64),
            Self::Lines { last, started } => {
                let Ok(mut last) = last.try_lock() else { return };
                if last.elapsed() >= Duration::from_secs(5) {
                    *last = Instant::now();
                    let spent = started.elapsed().as_secs_f64();
                    let left = spent * (1.0 - fraction) / fraction.max(1e-9);
                    let passes = if passes > 0 { format!("{passes} passes  ") } else { String::new() };
                    eprintln!("{:5.1} %  {passes}{spent:.0} s so far, {left:.0} s left", 100.0 * fraction);
                }
            }
        }
    }
}
