//! The content of a PLY file as records.

/// How the elements are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// decimal text, one row a line
    Ascii,
    /// binary, least significant byte first
    LittleEndian,
    /// binary, most significant byte first
    BigEndian,
}

/// Type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// char, int8
    I8,
    /// uchar, uint8
    U8,
    /// short, int16
    I16,
    /// ushort, uint16
    U16,
    /// int, int32
    I32,
    /// uint, uint32
    U32,
    /// float, float32
    F32,
    /// double, float64
    F64,
}

impl Type {
    pub(super) fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether the type is float or double.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Smallest and largest integer of the type.
    fn range(self) -> (i64, i64) {
        match self {
            Self::I8 => (-128, 127),
            Self::U8 => (0, 255),
            Self::I16 => (-32_768, 32_767),
            Self::U16 => (0, 65_535),
            Self::I32 => (i64::from(i32::MIN), i64::from(i32::MAX)),
            _ => (0, i64::from(u32::MAX)),
        }
    }

    pub(super) fn decode(self, bytes: &[u8], big: bool) -> f64 {
        let mut raw = [0u8; 8];
        let n = self.size();
        raw[..n].copy_from_slice(&bytes[..n]);
        if big {
            raw[..n].reverse();
        }
        let word = u64::from_le_bytes(raw);
        match self {
            Self::I8 => f64::from(word as u8 as i8),
            Self::U8 => f64::from(word as u8),
            Self::I16 => f64::from(word as u16 as i16),
            Self::U16 => f64::from(word as u16),
            Self::I32 => f64::from(word as u32 as i32),
            Self::U32 => f64::from(word as u32),
            Self::F32 => f64::from(f32::from_bits(word as u32)),
            Self::F64 => f64::from_bits(word),
        }
    }

    pub(super) fn decode_text(self, word: &str) -> Option<f64> {
        match self {
            // Rounded once, to the type of the property.
            Self::F32 => word.parse::<f32>().ok().map(f64::from),
            Self::F64 => word.parse::<f64>().ok(),
            _ => {
                let (lo, hi) = self.range();
                word.parse::<i64>().ok().filter(|x| (lo..=hi).contains(x)).map(|x| x as f64)
            }
        }
    }
}

/// Values of one property; single precision where that holds them exactly.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    Narrow(Vec<f32>),
    Wide(Vec<f64>),
}

impl Values {
    pub(super) fn of(kind: Type, capacity: usize) -> Self {
        match kind {
            Type::I32 | Type::U32 | Type::F64 => Self::Wide(Vec::with_capacity(capacity)),
            _ => Self::Narrow(Vec::with_capacity(capacity)),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Narrow(v) => v.len(),
            Self::Wide(v) => v.len(),
        }
    }

    fn get(&self, i: usize) -> f64 {
        match self {
            Self::Narrow(v) => f64::from(v[i]),
            Self::Wide(v) => v[i],
        }
    }

    pub(super) fn push(&mut self, x: f64) {
        match self {
            Self::Narrow(v) => v.push(x as f32),
            Self::Wide(v) => v.push(x),
        }
    }
}

/// One scalar property of all rows of an element.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name of the property.
    pub name: String,
    /// Its type in the file.
    pub kind: Type,
    pub(super) values: Values,
}

impl Column {
    /// Row `i`, exact.
    pub fn f64(&self, i: usize) -> f64 {
        self.values.get(i)
    }

    /// Row `i`, rounded to single precision.
    pub fn f32(&self, i: usize) -> f32 {
        match &self.values {
            Values::Narrow(v) => v[i],
            Values::Wide(v) => v[i] as f32,
        }
    }
}

/// One element, such as all vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// Name of the element.
    pub name: String,
    /// Number of rows.
    pub rows: usize,
    /// Its scalar properties, in the order of the file.
    pub columns: Vec<Column>,
    /// Its list properties, in the order of the file; empty unless read by [`parse_with_lists`](super::ply::parse_with_lists).
    pub lists: Vec<List>,
}

/// One list property of all rows of an element.
#[derive(Clone, Debug, PartialEq)]
pub struct List {
    /// Name of the property.
    pub name: String,
    /// Where each row's values end.
    pub(super) ends: Vec<usize>,
    pub(super) values: Values,
}

impl List {
    /// The values of row `i`, exact.
    pub fn row(&self, i: usize) -> impl Iterator<Item = f64> + '_ {
        (self.from(i)..self.ends[i]).map(|k| self.values.get(k))
    }

    /// Number of values of row `i`.
    pub fn row_len(&self, i: usize) -> usize {
        self.ends[i] - self.from(i)
    }

    /// Value `k` of row `i`, exact, if the row has it.
    pub fn get(&self, i: usize, k: usize) -> Option<f64> {
        (k < self.row_len(i)).then(|| self.values.get(self.from(i) + k))
    }

    fn from(&self, i: usize) -> usize {
        if i == 0 { 0 } else { self.ends[i - 1] }
    }

    /// Ends the current row.
    pub(super) fn end_row(&mut self) {
        self.ends.push(self.values.len());
    }
}

impl Element {
    /// The property of that name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.name == name)
    }

    /// The list property of that name.
    pub fn list(&self, name: &str) -> Option<&List> {
        self.lists.iter().find(|l| l.name == name)
    }
}

/// A file.
#[derive(Clone, Debug, PartialEq)]
pub struct Ply {
    /// How it was written.
    pub format: Format,
    /// Text of the `comment` and `obj_info` lines.
    pub comments: Vec<String>,
    /// Its elements.
    pub elements: Vec<Element>,
}

impl Ply {
    /// The element of that name.
    pub fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }
}
