//! Memory for large arrays that are read at random.
//!
//! A walk through a tree of some ten megabytes spends most of its time on address translation if the memory comes in small pages.
//! So large arrays live in anonymous memory maps for which huge pages are requested; where there are none to be had, nothing but speed is lost.

use memmap2::MmapMut;
use std::marker::PhantomData;
use wide::bytemuck::{self, Pod};

/// Below this size, bytes, a plain vector does.
const LARGE: usize = 1 << 21;

/// A fixed array in memory of its own.
pub(super) struct Pages<T> {
    memory: Memory<T>,
}

enum Memory<T> {
    Mapped(MmapMut, usize, PhantomData<T>),
    Plain(Vec<T>),
}

impl<T: Pod> Pages<T> {
    /// Zeros.
    pub(super) fn zeroed(len: usize) -> Self {
        let bytes = len * size_of::<T>();
        if bytes >= LARGE
            && let Ok(map) = MmapMut::map_anon(bytes)
            && map.as_ptr().align_offset(align_of::<T>()) == 0
        {
            #[cfg(target_os = "linux")]
            // A refusal leaves small pages, which are as good in everything but speed.
            let _ = map.advise(memmap2::Advice::HugePage);
            return Self { memory: Memory::Mapped(map, len, PhantomData) };
        }
        Self { memory: Memory::Plain(vec![T::zeroed(); len]) }
    }

    /// All entries.
    #[inline(always)]
    pub(super) fn all(&self) -> &[T] {
        match &self.memory {
            Memory::Mapped(map, len, _) => bytemuck::cast_slice(&map[..len * size_of::<T>()]),
            Memory::Plain(v) => v,
        }
    }

    /// All entries, to be written.
    pub(super) fn all_mut(&mut self) -> &mut [T] {
        match &mut self.memory {
            Memory::Mapped(map, len, _) => bytemuck::cast_slice_mut(&mut map[..*len * size_of::<T>()]),
            Memory::Plain(v) => v,
        }
    }
}

impl<T: Pod> Clone for Pages<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeroed(self.all().len());
        copy.all_mut().copy_from_slice(self.all());
        copy
    }
}
