//! The machine that figures were measured on.

use std::fs;

use serde::Serialize;

/// What a reader must know about a machine to make sense of times.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    pub cpu: String,
    /// Worker threads.
    pub threads: usize,
    pub processors: usize,
    /// Processes that wanted to run in the minute before the measurement began; `None` where the system does not tell.
    pub load: Option<f64>,
    pub version: &'static str,
    pub commit: &'static str,
}

impl Machine {
    /// This machine, now.
    pub fn here() -> Self {
        let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let name = cpuinfo.lines().find(|l| l.starts_with("model name")).and_then(|l| l.split_once(':'));
        let load = fs::read_to_string("/proc/loadavg").ok();
        Self {
            cpu: name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, n)| n.trim().to_owned()),
            threads: rayon::current_num_threads(),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            load: load.and_then(|l| l.split_whitespace().next()?.parse().ok()),
            version: env!("CARGO_PKG_VERSION"),
            commit: env!("CAUSTICA_COMMIT"),
        }
    }

    /// Other programs kept the processors from this one.
    pub fn busy(&self) -> bool {
        self.load.is_some_and(|l| l > 0.25 * self.processors as f64)
    }
}

/// Processor seconds that this process has used, all threads together; `None` where the system does not tell.
pub fn cpu_seconds() -> Option<f64> {
    // Fields 14 and 15 of proc(5), user and system time, in hundredths of a second; the name before them is in brackets.
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn processor_time_grows() {
        let before = cpu_seconds().expect("Linux tells");
        let mut sum = 0u64;
        for i in 0..200_000_000u64 {
            sum = sum.wrapping_add(std::hint::black_box(i));
        }
        std::hint::black_box(sum);
        assert!(cpu_seconds().expect("Linux tells") > before);
        assert!(Machine::here().threads > 0 && !Machine::here().cpu.is_empty());
    }
}
