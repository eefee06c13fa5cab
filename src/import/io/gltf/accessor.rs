//! Accessors: bounds first, then values.

use crate::{Error, Result};
use gltf::accessor::{DataType, Dimensions, sparse};
use gltf::buffer::View;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The buffers of a file, and how much may still be decoded from them.
pub(super) struct Buffers<'a> {
    pub(super) name: &'a str,
    /// In the order of the file.
    data: Vec<Arc<Vec<u8>>>,
    left: Cell<u64>,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(name: &'a str, data: Vec<Arc<Vec<u8>>>) -> Self {
        let bytes = data.iter().fold(0u64, |n, b| n.saturating_add(b.len() as u64));
        Self { name, data, left: Cell::new(bytes.saturating_mul(16).saturating_add(64 << 20)) }
    }

    fn error(&self, accessor: &gltf::Accessor<'_>, what: &str) -> Error {
        Error::input(self.name).at(format!("accessors[{}]{what}", accessor.index()))
    }

    /// The bytes of a view.
    pub(super) fn view(&self, view: &View<'_>) -> Result<&[u8]> {
        let buffer = &self.data[view.buffer().index()];
        let range = view.offset().checked_add(view.length()).and_then(|end| buffer.get(view.offset()..end));
        range.ok_or_else(|| {
            Error::input(self.name)
                .at(format!("bufferViews[{}]", view.index()))
                .expected(format!("a range inside the {} bytes of its buffer", buffer.len()))
                .got(format!("{} bytes from byte {}", view.length(), view.offset()))
        })
    }

    /// `count` elements of `size` bytes from `offset` of a view, `stride` apart: the bytes from the first to
    /// the end of the last.
    fn elements(
        &self,
        accessor: &gltf::Accessor<'_>,
        view: &View<'_>,
        offset: usize,
        count: usize,
        size: usize,
    ) -> Result<(&[u8], usize)> {
        let bytes = self.view(view)?;
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            return Err(self
                .error(accessor, ", stride")
                .expected(format!("at least {size} bytes"))
                .got(stride.to_string()));
        }
        // stride · (count − 1) + size bytes
        let span =
            count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride).and_then(|s| s.checked_add(size)));
        let found = span
            .and_then(|s| offset.checked_add(s))
            .and_then(|end| bytes.get(offset..end))
            .map(|b| (b, stride));
        found.ok_or_else(|| {
            self.error(accessor, "")
                .expected(format!("{count} elements of {size} bytes inside a view of {} bytes", bytes.len()))
                .got(format!("a stride of {stride} from byte {offset}"))
        })
    }

    /// All elements of an accessor, one call of `put` per element in order; `value` decodes one component.
    fn decode<T: Copy + Default, const N: usize>(
        &self,
        accessor: &gltf::Accessor<'_>,
        value: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<[T; N]>> {
        let width = accessor.data_type().size();
        // Columns of a matrix are padded to four bytes; only f32 matrices are read, which need no padding.
        let size = width * N;
        let count = accessor.count();
        let cost = (count as u64).saturating_mul((size_of::<T>() * N) as u64);
        if cost > self.left.get() {
            return Err(self
                .error(accessor, ", count")
                .expected("accessors that decode to at most 16 times their buffers")
                .got(count.to_string()));
        }
        let element = |b: &[u8]| std::array::from_fn(|k| value(&b[k * width..(k + 1) * width]));
        // Bounds come before memory.
        let base = accessor.view().map(|v| self.elements(accessor, &v, accessor.offset(), count, size));
        let base = base.transpose()?;
        self.left.set(self.left.get() - cost);
        let mut out: Vec<[T; N]> = match base {
            Some((bytes, stride)) => {
                (0..count).map(|i| element(&bytes[i * stride..i * stride + size])).collect()
            }
            None => vec![[T::default(); N]; count],
        };
        if let Some(s) = accessor.sparse() {
            self.sparse(accessor, &s, size, &mut out, &element)?;
        }
        Ok(out)
    }

    fn sparse<E>(
        &self,
        accessor: &gltf::Accessor<'_>,
        s: &sparse::Sparse<'_>,
        size: usize,
        out: &mut [E],
        element: &impl Fn(&[u8]) -> E,
    ) -> Result<()> {
        let (indices, values) = (s.indices(), s.values());
        let width = indices.index_type().size();
        let (at, at_stride) = self.elements(accessor, &indices.view(), indices.offset(), s.count(), width)?;
        let (new, new_stride) = self.elements(accessor, &values.view(), values.offset(), s.count(), size)?;
        for i in 0..s.count() {
            let b = &at[i * at_stride..];
            let index = match indices.index_type() {
                sparse::IndexType::U8 => u32::from(b[0]),
                sparse::IndexType::U16 => u32::from(u16::from_le_bytes([b[0], b[1]])),
                sparse::IndexType::U32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            };
            let count = out.len();
            let Some(slot) = out.get_mut(index as usize) else {
                return Err(self
                    .error(accessor, &format!(", sparse index {i}"))
                    .expected(format!("below {count}"))
                    .got(index.to_string()));
            };
            *slot = element(&new[i * new_stride..i * new_stride + size]);
        }
        Ok(())
    }

    fn wrong_type(&self, accessor: &gltf::Accessor<'_>, what: &str, expected: &str) -> Error {
        self.error(accessor, &format!(" ({what})")).expected(expected).got(format!(
            "{:?} of {:?}{}",
            accessor.dimensions(),
            accessor.data_type(),
            if accessor.normalized() { ", normalised" } else { "" }
        ))
    }

    fn shape(&self, accessor: &gltf::Accessor<'_>, what: &str, n: usize) -> Result<()> {
        let dimensions = match n {
            1 => Dimensions::Scalar,
            2 => Dimensions::Vec2,
            3 => Dimensions::Vec3,
            4 => Dimensions::Vec4,
            _ => Dimensions::Mat4,
        };
        if accessor.dimensions() == dimensions {
            Ok(())
        } else {
            Err(self.wrong_type(accessor, what, &format!("{dimensions:?}")))
        }
    }

    /// Finite floats; integers are divided by their largest value if the accessor is normalised, else kept.
    pub(super) fn floats<const N: usize>(
        &self,
        accessor: &gltf::Accessor<'_>,
        what: &str,
    ) -> Result<Vec<[f32; N]>> {
        self.shape(accessor, what, N)?;
        let normalized = accessor.normalized();
        let scaled = |x: f32, largest: f32| if normalized { x / largest } else { x };
        let signed = |x: f32, largest: f32| {
            crate::num::order::max(scaled(x, largest), if normalized { -1.0 } else { x })
        };
        let out: Vec<[f32; N]> = match accessor.data_type() {
            DataType::F32 => self.decode(accessor, |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            DataType::U8 => self.decode(accessor, |b| scaled(f32::from(b[0]), 255.0)),
            DataType::I8 => self.decode(accessor, |b| signed(f32::from(b[0].cast_signed()), 127.0)),
            DataType::U16 => {
                self.decode(accessor, |b| scaled(f32::from(u16::from_le_bytes([b[0], b[1]])), 65535.0))
            }
            DataType::I16 => {
                self.decode(accessor, |b| signed(f32::from(i16::from_le_bytes([b[0], b[1]])), 32767.0))
            }
            DataType::U32 => return Err(self.wrong_type(accessor, what, "floats or small integers")),
        }?;
        match out.iter().position(|row| !row.iter().all(|x| x.is_finite())) {
            None => Ok(out),
            Some(i) => Err(self
                .error(accessor, &format!(" ({what}), element {i}"))
                .expected("finite numbers")
                .got(format!("{:?}", out[i]))),
        }
    }

    /// Vertex indices.
    pub(super) fn indices(&self, accessor: &gltf::Accessor<'_>) -> Result<Vec<[u32; 1]>> {
        self.shape(accessor, "indices", 1)?;
        match accessor.data_type() {
            DataType::U8 => self.decode(accessor, |b| u32::from(b[0])),
            DataType::U16 => self.decode(accessor, |b| u32::from(u16::from_le_bytes([b[0], b[1]]))),
            DataType::U32 => self.decode(accessor, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            _ => Err(self.wrong_type(accessor, "indices", "unsigned integers")),
        }
    }

    /// Indices into the joints of a skin.
    pub(super) fn joints(&self, accessor: &gltf::Accessor<'_>) -> Result<Vec<[u16; 4]>> {
        self.shape(accessor, "joints", 4)?;
        match accessor.data_type() {
            DataType::U8 => self.decode(accessor, |b| u16::from(b[0])),
            DataType::U16 => self.decode(accessor, |b| u16::from_le_bytes([b[0], b[1]])),
            _ => Err(self.wrong_type(accessor, "joints", "u8 or u16")),
        }
    }
}

/// Decoded accessors, so that primitives and channels which share one in the file share it in memory.
#[derive(Default)]
pub(super) struct Cache {
    one: BTreeMap<usize, Arc<Vec<f32>>>,
    two: BTreeMap<usize, Arc<Vec<[f32; 2]>>>,
    three: BTreeMap<usize, Arc<Vec<[f32; 3]>>>,
    four: BTreeMap<usize, Arc<Vec<[f32; 4]>>>,
    padded: BTreeMap<usize, Arc<Vec<[f32; 4]>>>,
    joints: BTreeMap<usize, Arc<Vec<[u16; 4]>>>,
}

/// The entry of a map, made if there is none.
fn cached<T>(
    map: &mut BTreeMap<usize, Arc<T>>,
    a: &gltf::Accessor<'_>,
    make: impl FnOnce() -> Result<T>,
) -> Result<Arc<T>> {
    if let Some(known) = map.get(&a.index()) {
        return Ok(Arc::clone(known));
    }
    let new = Arc::new(make()?);
    map.insert(a.index(), Arc::clone(&new));
    Ok(new)
}

impl Cache {
    pub(super) fn get1(&mut self, b: &Buffers<'_>, a: &gltf::Accessor<'_>) -> Result<Arc<Vec<f32>>> {
        cached(&mut self.one, a, || Ok(b.floats::<1>(a, "times")?.into_iter().map(|[x]| x).collect()))
    }

    pub(super) fn get2(&mut self, b: &Buffers<'_>, a: &gltf::Accessor<'_>) -> Result<Arc<Vec<[f32; 2]>>> {
        cached(&mut self.two, a, || b.floats(a, "texture coordinates"))
    }

    pub(super) fn get3(
        &mut self,
        b: &Buffers<'_>,
        a: &gltf::Accessor<'_>,
        what: &str,
    ) -> Result<Arc<Vec<[f32; 3]>>> {
        cached(&mut self.three, a, || b.floats(a, what))
    }

    pub(super) fn get4(
        &mut self,
        b: &Buffers<'_>,
        a: &gltf::Accessor<'_>,
        what: &str,
    ) -> Result<Arc<Vec<[f32; 4]>>> {
        cached(&mut self.four, a, || b.floats(a, what))
    }

    pub(super) fn padded(&mut self, b: &Buffers<'_>, a: &gltf::Accessor<'_>) -> Result<Arc<Vec<[f32; 4]>>> {
        cached(&mut self.padded, a, || {
            let rows = b.floats::<3>(a, "translations and scales")?;
            Ok(rows.into_iter().map(|[x, y, z]| [x, y, z, 0.0]).collect())
        })
    }

    pub(super) fn joints(&mut self, b: &Buffers<'_>, a: &gltf::Accessor<'_>) -> Result<Arc<Vec<[u16; 4]>>> {
        cached(&mut self.joints, a, || b.joints(a))
    }
}
