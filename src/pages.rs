//! Arrays on large pages: rays and queries visit their trees at random, and with small pages every visit also misses the
//! page table.

use std::ops::{Deref, DerefMut};

use bytemuck::{AnyBitPattern, NoUninit};

/// Arrays from this many bytes on are mapped, with large pages where the system grants them.
const LARGE: usize = 4 << 20;

/// An array of zeros that may grow up to the capacity that it was made with.
#[derive(Debug)]
pub(crate) enum Pages<T> {
    Small(Vec<T>),
    /// The mapping and the number of elements in use. Pages that nobody has touched take no memory.
    Mapped(memmap2::MmapMut, usize),
}

impl<T: AnyBitPattern + NoUninit> Pages<T> {
    pub fn zeroed(len: usize) -> Self {
        let mut pages = Self::with_capacity(len);
        pages.extend_zeroed(len);
        pages
    }

    /// An empty array with room for `capacity` elements.
    pub fn with_capacity(capacity: usize) -> Self {
        let bytes = capacity * size_of::<T>();
        if bytes >= LARGE
            && let Ok(map) = memmap2::MmapOptions::new().len(bytes).no_reserve_swap().map_anon()
        {
            // A refusal costs speed only.
            #[cfg(target_os = "linux")]
            let _ = map.advise(memmap2::Advice::HugePage);
            return Self::Mapped(map, 0);
        }
        Self::Small(Vec::new())
    }

    /// Appends `n` zeroed elements, and returns them.
    pub fn extend_zeroed(&mut self, n: usize) -> &mut [T] {
        let old = self.len();
        match self {
            Self::Small(v) => v.resize(old + n, T::zeroed()),
            Self::Mapped(map, len) => {
                assert!((old + n) * size_of::<T>() <= map.len(), "a tree outgrew the room that was reserved for it");
                *len += n;
            }
        }
        &mut self[old..]
    }

    /// Forgets what follows the first elements. Not to be extended afterwards: that would find what was forgotten.
    pub fn truncate(&mut self, to: usize) {
        match self {
            Self::Small(v) => v.truncate(to),
            Self::Mapped(_, len) => *len = to.min(*len),
        }
    }

    /// Gives back what small arrays have allocated in vain.
    pub fn shrink(&mut self) {
        if let Self::Small(v) = self {
            v.shrink_to_fit();
        }
    }
}

impl<T: AnyBitPattern + NoUninit> Deref for Pages<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match self {
            Self::Small(v) => v,
            Self::Mapped(map, len) => bytemuck::cast_slice(&map[..*len * size_of::<T>()]),
        }
    }
}

impl<T: AnyBitPattern + NoUninit> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Small(v) => v,
            Self::Mapped(map, len) => bytemuck::cast_slice_mut(&mut map[..*len * size_of::<T>()]),
        }
    }
}
