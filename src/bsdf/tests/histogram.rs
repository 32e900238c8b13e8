//! A histogram of directions whose bins follow the samples, and Pearson's test against a density.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::Vec3;

/// A cell in `(1 − |cos θ|, φ)` of one hemisphere; those coordinates have uniform area and keep their digits at the pole.
#[derive(Clone, Copy)]
struct Cell {
    upper: bool,
    h: [f64; 2],
    phi: [f64; 2],
}

impl Cell {
    fn split(&self) -> [Self; 4] {
        let (hm, pm) = (0.5 * (self.h[0] + self.h[1]), 0.5 * (self.phi[0] + self.phi[1]));
        let make = |h, phi| Self { upper: self.upper, h, phi };
        [
            make([self.h[0], hm], [self.phi[0], pm]),
            make([hm, self.h[1]], [self.phi[0], pm]),
            make([self.h[0], hm], [pm, self.phi[1]]),
            make([hm, self.h[1]], [pm, self.phi[1]]),
        ]
    }

    /// Gauss–Legendre with 5×5 points.
    fn gauss(&self, density: &dyn Fn(Vec3) -> f64) -> f64 {
        const X: [f64; 5] =
            [-0.906_179_845_938_664, -0.538_469_310_105_683_1, 0.0, 0.538_469_310_105_683_1, 0.906_179_845_938_664];
        const W: [f64; 5] = [
            0.236_926_885_056_189_1,
            0.478_628_670_499_366_5,
            0.568_888_888_888_888_9,
            0.478_628_670_499_366_5,
            0.236_926_885_056_189_1,
        ];
        let at = |r: [f64; 2], x: f64| 0.5 * (r[0] + r[1]) + 0.5 * (r[1] - r[0]) * x;
        let mut sum = 0.0;
        for i in 0..5 {
            for j in 0..5 {
                let (h, phi) = (at(self.h, X[i]), at(self.phi, X[j]));
                let r = (h * (2.0 - h)).sqrt();
                let z = if self.upper { 1.0 - h } else { h - 1.0 };
                let w = Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32);
                sum += W[i] * W[j] * density(w);
            }
        }
        sum * 0.25 * (self.h[1] - self.h[0]) * (self.phi[1] - self.phi[0])
    }

    /// Integral by halving until two levels agree to `tolerance`.
    fn integrate(&self, density: &dyn Fn(Vec3) -> f64, whole: f64, tolerance: f64, depth: u32) -> f64 {
        let parts = self.split();
        let sums = parts.map(|c| c.gauss(density));
        let sum: f64 = sums.iter().sum();
        // Large cells are split unseen: their samples may sit in a corner between the points.
        let area = (self.h[1] - self.h[0]) * (self.phi[1] - self.phi[0]);
        if depth == 0 || (area < 4.0 * PI / 4096.0 && (sum - whole).abs() < tolerance) {
            return sum;
        }
        (0..4).map(|i| parts[i].integrate(density, sums[i], 0.35 * tolerance, depth - 1)).sum()
    }
}

enum Node {
    Leaf(usize),
    Inner([usize; 4]),
}

/// Bins made from pilot samples.
pub struct Histogram {
    nodes: Vec<(Cell, Node)>,
    cells: Vec<Cell>,
}

impl Histogram {
    /// Splits bins until none holds more than `limit` of the pilot directions.
    pub fn new(pilot: &[Vec3], limit: usize) -> Self {
        let mut this = Self { nodes: Vec::new(), cells: Vec::new() };
        for upper in [true, false] {
            for q in 0..4 {
                let phi = [q as f64 * FRAC_PI_2, (q + 1) as f64 * FRAC_PI_2];
                this.nodes.push((Cell { upper, h: [0.0, 1.0], phi }, Node::Leaf(0)));
            }
        }
        let coordinates: Vec<_> = pilot.iter().map(|&w| Self::coordinates(w)).collect();
        for root in 0..8 {
            let members: Vec<usize> = (0..pilot.len()).filter(|&i| Self::root(coordinates[i]) == root).collect();
            this.grow(root, members, &coordinates, limit, 0);
        }
        this
    }

    fn coordinates(w: Vec3) -> (bool, f64, f64) {
        let (x, y, z) = (w.x as f64, w.y as f64, w.z as f64);
        let phi = y.atan2(x);
        let len = (x * x + y * y + z * z).sqrt();
        let h = (x * x + y * y) / (len * (len + z.abs()));
        (z > 0.0, h.min(1.0 - 1e-16), if phi < 0.0 { (phi + 2.0 * PI).min(2.0 * PI * (1.0 - 1e-16)) } else { phi })
    }

    fn root((upper, _, phi): (bool, f64, f64)) -> usize {
        ((phi / FRAC_PI_2) as usize).min(3) + if upper { 0 } else { 4 }
    }

    fn quarter(cell: &Cell, (_, h, phi): (bool, f64, f64)) -> usize {
        (h >= 0.5 * (cell.h[0] + cell.h[1])) as usize + 2 * (phi >= 0.5 * (cell.phi[0] + cell.phi[1])) as usize
    }

    fn grow(&mut self, node: usize, members: Vec<usize>, at: &[(bool, f64, f64)], limit: usize, depth: u32) {
        let cell = self.nodes[node].0;
        if members.len() <= limit || depth > 24 {
            self.nodes[node].1 = Node::Leaf(self.cells.len());
            self.cells.push(cell);
            return;
        }
        let first = self.nodes.len();
        self.nodes[node].1 = Node::Inner([first, first + 1, first + 2, first + 3]);
        self.nodes.extend(cell.split().map(|c| (c, Node::Leaf(0))));
        for q in 0..4 {
            let part = members.iter().copied().filter(|&i| Self::quarter(&cell, at[i]) == q).collect();
            self.grow(first + q, part, at, limit, depth + 1);
        }
    }

    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// The bin of a direction.
    pub fn bin(&self, w: Vec3) -> usize {
        let at = Self::coordinates(w);
        let mut node = Self::root(at);
        loop {
            match &self.nodes[node] {
                (_, Node::Leaf(bin)) => return *bin,
                (cell, Node::Inner(children)) => node = children[Self::quarter(cell, at)],
            }
        }
    }

    /// Integral of a density over every bin.
    pub fn integrate(&self, density: &dyn Fn(Vec3) -> f64) -> Vec<f64> {
        self.cells.iter().map(|c| c.integrate(density, c.gauss(density), 1e-7, 9)).collect()
    }
}

/// Probability of a χ² at least this large when the expectation is true; bins below 5 expected are pooled.
pub fn p_value(observed: &[f64], expected: &[f64]) -> f64 {
    let (mut chi, mut bins) = (0.0, 0);
    let (mut pool_o, mut pool_e) = (0.0, 0.0);
    for (&o, &e) in observed.iter().zip(expected) {
        if e < 5.0 {
            pool_o += o;
            pool_e += e;
        } else {
            chi += (o - e) * (o - e) / e;
            bins += 1;
        }
    }
    if pool_e >= 5.0 {
        chi += (pool_o - pool_e) * (pool_o - pool_e) / pool_e;
        bins += 1;
    } else if pool_o > 30.0 {
        // Where next to nothing may be, there is something.
        return 0.0;
    }
    if bins < 2 { 1.0 } else { gamma_q(0.5 * (bins - 1) as f64, 0.5 * chi) }
}

/// Regularised upper incomplete gamma function.
pub fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        // Series of the lower function.
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        for _ in 0..10_000 {
            n += 1.0;
            term *= x / n;
            sum += term;
            if term < sum * 1e-15 {
                break;
            }
        }
        1.0 - front * sum
    } else {
        // Continued fraction, modified Lentz.
        let mut b = x + 1.0 - a;
        let mut c = 1e300;
        let mut d = 1.0 / b;
        let mut h = d;
        for i in 1..10_000 {
            let an = -(i as f64) * (i as f64 - a);
            b += 2.0;
            d = 1.0 / (an * d + b);
            c = b + an / c;
            h *= d * c;
            if (d * c - 1.0).abs() < 1e-15 {
                break;
            }
        }
        front * h
    }
}

/// Stirling's series with the argument raised above 10.
fn ln_gamma(x: f64) -> f64 {
    let (mut x, mut shift) = (x, 0.0);
    while x < 10.0 {
        shift += x.ln();
        x += 1.0;
    }
    let i = 1.0 / (x * x);
    (x - 0.5) * x.ln() - x + 0.5 * (2.0 * PI).ln() + (1.0 / 12.0 - i * (1.0 / 360.0 - i / 1260.0)) / x - shift
}

#[test]
fn chi_square_probabilities_match_tables() {
    // Upper 5 % points of χ² with 1, 10 and 100 degrees of freedom.
    for (k, x) in [(1.0, 3.841_458_8), (10.0, 18.307_038), (100.0, 124.342_113)] {
        assert!((gamma_q(0.5 * k, 0.5 * x) - 0.05).abs() < 1e-7, "{k}");
    }
}
