//! nanoflann in a process of its own, where Debian's libnanoflann-dev and g++ are there.

use caustica::math::Vec3;
use std::io::{BufWriter, Read, Result, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A running `nanoflann.cpp` that has built its tree.
pub struct Nanoflann {
    process: Child,
    ask: Option<BufWriter<ChildStdin>>,
    answer: ChildStdout,
}

impl Nanoflann {
    /// Compiles the program and gives it the points; `None` when it cannot be compiled.
    pub fn start(points: &[Vec3]) -> Option<Self> {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/photon_map/nanoflann.cpp");
        let folder = tempfile::tempdir().ok()?;
        let program = folder.path().join("nanoflann");
        let options = ["-O3", "-march=native", "-std=c++17", "-o"];
        let compiled = Command::new("g++").args(options).arg(&program).arg(source).stderr(Stdio::null()).status();
        if !compiled.is_ok_and(|status| status.success()) {
            return None;
        }
        let mut process = Command::new(&program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().ok()?;
        let (ask, answer) = (process.stdin.take().map(BufWriter::new), process.stdout.take()?);
        let mut rival = Self { process, ask, answer };
        rival.send(&[points.len() as u64], points).ok()?;
        // An answer tells that the program has read everything: its file may go.
        rival.query(&points[..1], 1).ok()?;
        Some(rival)
    }

    fn send(&mut self, header: &[u64], points: &[Vec3]) -> Result<()> {
        let Some(ask) = &mut self.ask else { return Ok(()) };
        for number in header {
            ask.write_all(&number.to_ne_bytes())?;
        }
        for v in points.iter().flat_map(|p| p.to_array()) {
            ask.write_all(&v.to_ne_bytes())?;
        }
        ask.flush()
    }

    /// Seconds of the thread for these queries, and the sum of the k-th squared distances.
    pub fn query(&mut self, queries: &[Vec3], k: usize) -> Result<(f64, f64)> {
        self.send(&[queries.len() as u64, k as u64], queries)?;
        let mut number = || -> Result<f64> {
            let mut bytes = [0; 8];
            self.answer.read_exact(&mut bytes)?;
            Ok(f64::from_ne_bytes(bytes))
        };
        Ok((number()?, number()?))
    }
}

impl Drop for Nanoflann {
    fn drop(&mut self) {
        // Without input it ends by itself.
        self.ask = None;
        let _ = self.process.wait();
    }
}
