//! Memory for large arrays with random access.
//!
//! The traversal of a tree of some ten megabytes spends most of its time on address translation if the memory
//! consists of small pages. Large arrays are therefore anonymous memory maps for which huge pages are
//! requested; if none are available, only speed is affected.

use memmap2::MmapMut;
use std::marker::PhantomData;
use wide::bytemuck::{self, Pod};

/// Size in bytes below which a plain vector is used.
const LARGE: usize = 1 << 21;

/// A fixed-size array in separately mapped memory.
pub(super) struct Pages<T> {
    memory: Memory<T>,
}

enum Memory<T> {
    Mapped(MmapMut, usize, PhantomData<T>),
    Plain(Vec<T>),
}

impl<T: Pod> Pages<T> {
    /// Returns an array of zeros.
    pub(super) fn zeroed(len: usize) -> Self {
        let bytes = len * size_of::<T>();
        if bytes >= LARGE
            && let Ok(map) = MmapMut::map_anon(bytes)
            && map.as_ptr().align_offset(align_of::<T>()) == 0
        {
            #[cfg(target_os = "linux")]
            // If the request is refused, the pages stay small, which affects only speed.
            let _ = map.advise(memmap2::Advice::HugePage);
            return Self { memory: Memory::Mapped(map, len, PhantomData) };
        }
        Self { memory: Memory::Plain(vec![T::zeroed(); len]) }
    }

    /// Returns all entries.
    #[inline(always)]
    pub(super) fn all(&self) -> &[T] {
        match &self.memory {
            Memory::Mapped(map, len, _) => bytemuck::cast_slice(&map[..len * size_of::<T>()]),
            Memory::Plain(v) => v,
        }
    }

    /// Returns all entries for writing.
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
