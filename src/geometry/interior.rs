//! The media that a point lies in, where closed shapes of clear media overlap [Schmidt and Budge 2002].

/// The media around a point, strongest first, each as often as it was entered.
///
/// A medium is a rank from 1, the strongest; 0 is none. Up to eight ranks stand in the bytes of one word in ascending order
/// from the lowest, so that the list depends on where a point is and not on the way there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Interior(u64);

impl Interior {
    /// Inside of nothing.
    pub const NONE: Self = Self(0);

    /// Media that fit.
    pub const CAPACITY: u32 = 8;

    /// The medium that fills the point: the strongest, or 0.
    #[inline]
    pub fn top(self) -> u8 {
        self.0 as u8
    }

    /// The list with `medium`. When it is full the weakest is lost, and the second value is false.
    pub fn entered(self, medium: u8) -> (Self, bool) {
        let fits = self.0 >> (8 * (Self::CAPACITY - 1)) == 0;
        let Some(place) = (0..Self::CAPACITY).find(|&i| self.rank(i) == 0 || self.rank(i) > medium) else {
            return (self, false);
        };
        let weaker = self.0 >> (8 * place) << (8 * place);
        (Self((self.0 - weaker) | (medium as u64) << (8 * place) | weaker << 8), fits)
    }

    /// The list without one `medium`; `None` when it is not on it.
    pub fn left(self, medium: u8) -> Option<Self> {
        let place = (0..Self::CAPACITY).find(|&i| self.rank(i) == medium)?;
        let stronger = self.0 & ((1 << (8 * place)) - 1);
        let weaker = self.0 >> (8 * place) >> 8 << (8 * place);
        Some(Self(stronger | weaker))
    }

    fn rank(self, i: u32) -> u8 {
        (self.0 >> (8 * i)) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(ranks: &[u8]) -> Interior {
        ranks.iter().fold(Interior::NONE, |list, &m| list.entered(m).0)
    }

    #[test]
    fn the_strongest_is_on_top_whatever_the_order() {
        assert_eq!(Interior::NONE.top(), 0);
        assert_eq!(of(&[3]).top(), 3);
        assert_eq!(of(&[3, 1, 2]), of(&[2, 3, 1]));
        assert_eq!(of(&[3, 1, 2]).top(), 1);
        assert_eq!(of(&[255, 254]).top(), 254);
    }

    #[test]
    fn leaving_undoes_entering() {
        for list in [of(&[]), of(&[2]), of(&[1, 5, 9]), of(&[1, 2, 3, 4, 5, 6, 7])] {
            for m in [1, 4, 5, 7, 255] {
                assert_eq!(list.entered(m), (list.entered(m).0, true));
                assert_eq!(list.entered(m).0.left(m), Some(list), "{list:?} {m}");
            }
        }
    }

    #[test]
    fn what_was_entered_twice_is_left_twice() {
        let once = of(&[4, 4, 2]).left(4).expect("entered");
        assert_eq!(once, of(&[2, 4]));
        assert_eq!(once.left(4), Some(of(&[2])));
        assert_eq!(of(&[2]).left(4), None);
        assert_eq!(Interior::NONE.left(1), None);
    }

    #[test]
    fn the_ninth_is_counted_and_the_weakest_is_lost() {
        let full = of(&[10, 20, 30, 40, 50, 60, 70, 80]);
        assert_eq!(full.entered(90), (full, false));
        assert_eq!(full.entered(15), (of(&[10, 15, 20, 30, 40, 50, 60, 70]), false));
        assert_eq!(full.left(80), Some(of(&[10, 20, 30, 40, 50, 60, 70])));
        assert_eq!(full.left(10).expect("on the list").top(), 20);
    }
}
