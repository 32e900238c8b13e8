//! Arrays on large pages: a ray visits a tree at random, and with small pages every visit also misses the page table.

use std::ops::{Deref, DerefMut};

use bytemuck::{AnyBitPattern, NoUninit};

/// Arrays from this many bytes on are mapped, with large pages where the system grants them.
const LARGE: usize = 4 << 20;

/// A zeroed array of fixed length.
#[derive(Debug)]
pub(super) enum Pages<T> {
    Small(Vec<T>),
    /// The mapping and the number of elements.
    Mapped(memmap2::MmapMut, usize),
}

impl<T: AnyBitPattern + NoUninit> Pages<T> {
    pub fn zeroed(len: usize) -> Self {
        let bytes = len * size_of::<T>();
        if bytes >= LARGE
            && let Ok(map) = memmap2::MmapMut::map_anon(bytes)
        {
            // A refusal costs speed only.
            #[cfg(target_os = "linux")]
            let _ = map.advise(memmap2::Advice::HugePage);
            return Self::Mapped(map, len);
        }
        Self::Small(vec![T::zeroed(); len])
    }
}

impl<T: AnyBitPattern + NoUninit> Deref for Pages<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match self {
            Self::Small(v) => v,
            Self::Mapped(map, len) => &bytemuck::cast_slice(map)[..*len],
        }
    }
}

impl<T: AnyBitPattern + NoUninit> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Small(v) => v,
            Self::Mapped(map, len) => &mut bytemuck::cast_slice_mut(map)[..*len],
        }
    }
}
