//! Arithmetic of the left-balanced heap: a complete binary tree whose last level is filled from the left.
//!
//! Slots count from 1: the children of slot `i` are `2i` and `2i + 1`, its parent is `i / 2`, and the subtree under `i`
//! is, `d` levels down, the contiguous run of slots from `i·2^d` to `i·2^d + 2^d − 1`.

/// `⌊log₂ n⌋` for n ≥ 1: the level of slot n, the root being level 0.
#[inline]
pub(crate) fn level(n: usize) -> u32 {
    n.ilog2()
}

/// Number of nodes left of the root in a left-balanced tree of `n ≥ 1` nodes.
#[inline]
pub(crate) fn left_size(n: usize) -> usize {
    if n < 2 {
        return 0;
    }
    // Half of the full levels below the root, and as much of the last level as fits on the left.
    let half = 1 << (level(n) - 1);
    let last = n - (2 * half - 1);
    half - 1 + last.min(half)
}

/// Place of a slot when the tree of `n` nodes is read from left to right, counted from 0.
#[inline]
pub(crate) fn rank(slot: usize, n: usize) -> usize {
    let (h, l) = (level(n), level(slot));
    // The place it has if the last level is full; then leave out the missing nodes to its left, which are every second
    // place from 2·last on.
    let place = ((2 * (slot - (1 << l)) + 1) << (h - l)) - 1;
    let last = n + 1 - (1 << h);
    place - (place + 1).saturating_sub(2 * last) / 2
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In-order walk by child arithmetic alone.
    fn walk(slot: usize, n: usize, out: &mut Vec<usize>) {
        if slot <= n {
            walk(2 * slot, n, out);
            out.push(slot);
            walk(2 * slot + 1, n, out);
        }
    }

    fn count(slot: usize, n: usize) -> usize {
        if slot > n { 0 } else { 1 + count(2 * slot, n) + count(2 * slot + 1, n) }
    }

    #[test]
    fn left_size_and_rank_agree_with_a_walk() {
        for n in (1..300).chain([511, 512, 513, 1000, 4095, 4096]) {
            assert_eq!(left_size(n), count(2, n), "n = {n}");
            let mut order = Vec::new();
            walk(1, n, &mut order);
            for (place, &slot) in order.iter().enumerate() {
                assert_eq!(rank(slot, n), place, "slot {slot} of {n}");
            }
        }
    }
}
