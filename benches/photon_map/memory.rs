//! What the machine's memory gives to one thread.

use caustica::sample::mix64;
use std::hint::black_box;

/// Times that the array is read in order: the clock of a thread may tick in steps of milliseconds.
const PASSES: usize = 64;

/// A cache line.
#[derive(Clone)]
#[repr(align(64))]
struct Line([u64; 8]);

/// Bytes per second read in order, and cache lines per second read at random, from an array of so many bytes. `seconds`
/// times a piece of work.
pub fn rates(bytes: usize, seconds: impl Fn(&mut dyn FnMut()) -> f64) -> (f64, f64) {
    let lines: Vec<Line> = (0..(bytes / 64) as u64).map(|i| Line([i; 8])).collect();
    let best = |work: &mut dyn FnMut()| (0..5).map(|_| seconds(work)).fold(f64::INFINITY, f64::min);
    let in_order = best(&mut || {
        for _ in 0..PASSES {
            let mut sums = [0u64; 8];
            for line in black_box(&lines) {
                for (sum, v) in sums.iter_mut().zip(line.0) {
                    *sum = sum.wrapping_add(v);
                }
            }
            black_box(sums);
        }
    });
    // The addresses do not depend on what was read, so that as many reads are under way as the machine can have.
    let count = 4_000_000;
    let at_random = best(&mut || {
        let place = |i: u64| ((u128::from(mix64(i)) * lines.len() as u128) >> 64) as usize;
        black_box((0..count).fold(0u64, |sum, i| sum.wrapping_add(lines[place(i)].0[0])));
    });
    ((PASSES * bytes) as f64 / in_order, count as f64 / at_random)
}
