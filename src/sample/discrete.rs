/// A discrete distribution sampled by inversion, so that stratified numbers stay stratified.
///
/// Weights that are negative or not finite count as zero. Sums are in f64.
#[derive(Clone, Debug, Default)]
pub struct Cdf {
    /// `cumulative[i]` is the probability of the items before `i`; one entry more than there are items, and behind them
    /// [`STRIDE`] that no number reaches.
    cumulative: Vec<f32>,
    /// For each of `2ᵏ` equal parts of [0, 1) the number of entries up to where it begins, and their number in all; empty for
    /// few or very many items.
    guide: Vec<u16>,
    total: f64,
}

/// Items from which on a guide is worth its memory.
const GUIDED: usize = 8;

/// Items up to which many numbers are compared with each of them.
const SIDE_BY_SIDE: usize = 8;

/// Entries that are compared at a time.
const STRIDE: usize = 4;

impl Cdf {
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut sums = vec![0.0f64];
        let mut total = 0.0;
        for w in weights {
            if w > 0.0 && w.is_finite() {
                total += w;
            }
            sums.push(total);
        }
        let inv = if total > 0.0 { 1.0 / total } else { 0.0 };
        let mut cumulative: Vec<f32> = sums.iter().map(|s| (s * inv) as f32).collect();
        let guide = if (GUIDED..u16::MAX as usize).contains(&cumulative.len()) && total > 0.0 {
            let parts = (cumulative.len() / 2).next_power_of_two();
            let before = |part: usize| cumulative.partition_point(|&c| c <= part as f32 / parts as f32) as u16;
            (0..parts).map(before).chain([cumulative.len() as u16]).collect()
        } else {
            Vec::new()
        };
        cumulative.extend([f32::INFINITY; STRIDE]);
        Self { cumulative, guide, total }
    }

    /// Number of entries up to `u`, 0 ≤ u < 1.
    #[inline(always)]
    fn up_to(&self, u: f32) -> usize {
        let mut low = 0;
        if let Some(parts) = self.guide.len().checked_sub(1) {
            // A power of two: the product is exact.
            let part = ((u * parts as f32) as usize).min(parts - 1);
            low = self.guide[part] as usize;
        } else if self.cumulative.len() > GUIDED + STRIDE {
            return self.cumulative.partition_point(|&c| c <= u);
        }
        // Count in place of branches that nobody can foresee; there is rarely more than one round.
        loop {
            let next = &self.cumulative[low..low + STRIDE];
            let passed = next.iter().map(|&c| usize::from(c <= u)).sum::<usize>();
            low += passed;
            if passed < STRIDE {
                return low;
            }
        }
    }

    #[inline]
    pub fn len(&self) -> usize {
        self.cumulative.len().saturating_sub(1 + STRIDE)
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Probability of item `i`.
    #[inline(always)]
    pub fn pmf(&self, i: usize) -> f32 {
        self.cumulative[i + 1] - self.cumulative[i]
    }

    /// An item, its probability, and the number that is left over, uniform in [0, 1). `None` when all weights are zero.
    #[inline(always)]
    pub fn sample(&self, u: f32) -> Option<(usize, f32, f32)> {
        if self.total <= 0.0 {
            return None;
        }
        // The last item whose cumulative probability is at most u; items of probability zero are never it.
        let mut i = self.up_to(u).clamp(1, self.len()) - 1;
        while self.pmf(i) <= 0.0 && i > 0 {
            i -= 1;
        }
        let p = self.pmf(i);
        if p <= 0.0 {
            return None;
        }
        let rest = ((u - self.cumulative[i]) / p).clamp(0.0, 1.0f32.next_down());
        Some((i, p, rest))
    }

    /// The items of [`Cdf::sample`] for all of `u`, [`u32::MAX`] for none, and their probabilities.
    #[inline(always)]
    pub fn sample_all<const N: usize>(&self, u: &[f32; N], items: &mut [u32; N], pmf: &mut [f32; N]) {
        if self.len() > SIDE_BY_SIDE || self.total <= 0.0 {
            for i in 0..N {
                let (item, p) = self.sample(u[i]).map_or((u32::MAX, 1.0), |(item, p, _)| (item as u32, p));
                (items[i], pmf[i]) = (item, p);
            }
            return;
        }
        // Item after item, so that the numbers go through in vectors. What ends where it begins is passed with its beginning.
        (*items, *pmf) = ([0; N], [self.pmf(0); N]);
        for item in 1..self.len() {
            let (begin, p) = (self.cumulative[item], self.pmf(item));
            for i in 0..N {
                let passed = (begin <= u[i]) & (p > 0.0);
                items[i] = if passed { item as u32 } else { items[i] };
                pmf[i] = if passed { p } else { pmf[i] };
            }
        }
    }
}

/// A discrete distribution sampled in constant time [Vose 1991].
#[derive(Clone, Debug, Default)]
pub struct AliasTable {
    bins: Vec<(f32, u32)>,
    pmf: Vec<f32>,
}

impl AliasTable {
    /// Weights that are negative or not finite count as zero; all zero gives an empty table.
    pub fn new(weights: &[f64]) -> Self {
        let clean = |w: f64| if w > 0.0 && w.is_finite() { w } else { 0.0 };
        let total: f64 = weights.iter().copied().map(clean).sum();
        if total <= 0.0 {
            return Self::default();
        }
        let n = weights.len();
        let mut scaled: Vec<f64> = weights.iter().map(|&w| clean(w) / total * n as f64).collect();
        let pmf = scaled.iter().map(|q| (q / n as f64) as f32).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| scaled[i] < 1.0);
        let mut bins = vec![(1.0f32, 0u32); n];
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            bins[s] = (scaled[s] as f32, l as u32);
            scaled[l] -= 1.0 - scaled[s];
            if scaled[l] < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        for i in small.into_iter().chain(large) {
            bins[i] = (1.0, i as u32);
        }
        Self { bins, pmf }
    }

    pub fn is_empty(&self) -> bool {
        self.bins.is_empty()
    }

    #[inline]
    pub fn pmf(&self, i: usize) -> f32 {
        self.pmf[i]
    }

    /// An item and its probability. `None` when all weights are zero.
    #[inline]
    pub fn sample(&self, u: f32) -> Option<(usize, f32)> {
        if self.bins.is_empty() {
            return None;
        }
        let x = u * self.bins.len() as f32;
        let i = (x as usize).min(self.bins.len() - 1);
        let (q, alias) = self.bins[i];
        let item = if x - (i as f32) < q { i } else { alias as usize };
        Some((item, self.pmf[item]))
    }
}

/// A piecewise-constant density on the unit square, rows first.
#[derive(Clone, Debug, Default)]
pub struct Distribution2d {
    width: usize,
    rows: Vec<Cdf>,
    marginal: Cdf,
}

impl Distribution2d {
    /// `weights` holds `height` rows of `width`; they need not be normalised.
    pub fn new(width: usize, height: usize, weights: &[f32]) -> Self {
        assert_eq!(weights.len(), width * height, "weights must fill the grid");
        let rows: Vec<Cdf> = weights.chunks(width.max(1)).map(|row| Cdf::new(row.iter().map(|&w| w as f64))).collect();
        let marginal = Cdf::new(rows.iter().map(Cdf::total));
        Self { width, rows, marginal }
    }

    /// Sum of the weights.
    pub fn total(&self) -> f64 {
        self.marginal.total()
    }

    /// A point in [0,1)² and its density with respect to the unit square.
    #[inline]
    pub fn sample(&self, u: glam::Vec2) -> Option<(glam::Vec2, f32)> {
        let (y, py, ry) = self.marginal.sample(u.y)?;
        let (x, px, rx) = self.rows[y].sample(u.x)?;
        let (w, h) = (self.width as f32, self.rows.len() as f32);
        Some((glam::Vec2::new((x as f32 + rx) / w, (y as f32 + ry) / h), px * w * py * h))
    }

    /// Density of [`Distribution2d::sample`] at `p`.
    #[inline]
    pub fn pdf(&self, p: glam::Vec2) -> f32 {
        let (w, h) = (self.width, self.rows.len());
        if w == 0 || h == 0 {
            return 0.0;
        }
        let x = ((p.x * w as f32) as usize).min(w - 1);
        let y = ((p.y * h as f32) as usize).min(h - 1);
        self.rows[y].pmf(x) * w as f32 * self.marginal.pmf(y) * h as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn cdf_never_returns_an_item_of_probability_zero() {
        let cdf = Cdf::new([0.0, 1.0, 0.0, 3.0, 0.0]);
        for i in 0..=1000 {
            let u = (i as f32 / 1000.0).min(1.0f32.next_down());
            let (item, p, rest) = cdf.sample(u).expect("positive total");
            assert!(p > 0.0 && (item == 1 || item == 3), "u = {u}: {item}");
            assert!((0.0..1.0).contains(&rest));
        }
        assert!(Cdf::new([0.0, f64::NAN, -1.0]).sample(0.5).is_none());
        assert!(Cdf::new([]).sample(0.5).is_none());
    }

    #[test]
    fn the_guide_finds_what_a_search_finds() {
        for len in [6, 7, 64, 100, 1000] {
            let weights = (0..len).map(|i| [0.0, 1e-9, 1.0, 3.0, 1e4][(i * 7 + i / 3) % 5]);
            let cdf = Cdf::new(weights);
            assert_eq!(cdf.guide.is_empty(), len < GUIDED - 1, "{len}");
            assert_eq!(cdf.len(), len);
            let edges = cdf.cumulative.iter().flat_map(|&c| [c.next_down(), c, c.next_up()]);
            for u in edges.chain((0..10_000).map(|i| i as f32 * 1e-4)).filter(|u| (0.0..1.0).contains(u)) {
                assert_eq!(cdf.up_to(u), cdf.cumulative.partition_point(|&c| c <= u), "{len} items, {u}");
            }
        }
    }

    #[test]
    fn items_side_by_side_are_those_of_one_number_after_the_other() {
        for weights in
            [vec![], vec![0.0], vec![2.0], vec![0.0, 1.0, 0.0, 3.0, 0.0], vec![1.0; 8], vec![1.0; 9], vec![1.0; 300]]
        {
            let cdf = Cdf::new(weights.iter().copied());
            let edges = cdf.cumulative.iter().flat_map(|&c| [c.next_down(), c, c.next_up()]);
            let mut numbers: Vec<f32> = edges.filter(|u| (0.0..1.0).contains(u)).collect();
            numbers.resize(numbers.len().next_multiple_of(16), 0.3);
            for u in numbers.as_chunks::<16>().0 {
                let (mut items, mut pmf) = ([7; 16], [7.0; 16]);
                cdf.sample_all(u, &mut items, &mut pmf);
                for i in 0..16 {
                    let one = cdf.sample(u[i]).map(|(item, p, _)| (item as u32, p));
                    assert_eq!((items[i] != u32::MAX).then_some((items[i], pmf[i])), one, "{weights:?}, {}", u[i]);
                }
            }
        }
    }

    #[test]
    fn alias_table_follows_its_weights() {
        let w = [1.0, 0.0, 2.0, 7.0];
        let table = AliasTable::new(&w);
        let mut count = [0u32; 4];
        for i in 0..10_000 {
            count[table.sample((i as f32 + 0.5) / 10_000.0).expect("positive total").0] += 1;
        }
        for (c, w) in count.iter().zip(w) {
            assert!((*c as f64 - 1000.0 * w).abs() < 10.0, "{count:?}");
        }
    }

    #[test]
    fn density_on_the_square_integrates_to_one_and_matches_samples() {
        let d = Distribution2d::new(3, 2, &[1.0, 0.0, 2.0, 4.0, 1.0, 0.0]);
        let mut sum = 0.0;
        for y in 0..2 {
            for x in 0..3 {
                sum += d.pdf(Vec2::new((x as f32 + 0.5) / 3.0, (y as f32 + 0.5) / 2.0)) / 6.0;
            }
        }
        assert!((sum - 1.0).abs() < 1e-6);
        for i in 0..100 {
            let u = Vec2::new((i as f32 * 0.37) % 1.0, (i as f32 * 0.61) % 1.0);
            let (p, pdf) = d.sample(u).expect("positive total");
            assert_eq!(pdf, d.pdf(p));
        }
    }
}
