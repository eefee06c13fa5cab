//! Conversion of named arrays to the typed inputs of a twin: the macro `inputs!` declares them, [`Dims`]
//! checks their shapes.

use std::collections::BTreeMap;

use crate::array::Arr;
use crate::ports::Port;

/// Sizes of the axes by letter.
#[derive(Clone, Debug, Default)]
pub struct Dims(BTreeMap<String, Vec<usize>>);

/// Sizes, comma-separated.
fn list(sizes: &[usize]) -> String {
    sizes.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
}

impl Dims {
    /// Size of the axis of that letter, if an array bound it.
    pub fn get(&self, letter: &str) -> Option<usize> {
        self.0.get(letter).map(|sizes| sizes[0])
    }

    /// Checks `shape` against `pattern`. A number is a fixed size; a letter is the same size everywhere;
    /// `...` is the same sequence of further axes everywhere; `|` separates alternatives.
    ///
    /// # Errors
    /// A description of the expected shape: the pattern and the sizes of the letters known so far.
    pub fn bind(&mut self, pattern: &str, shape: &[usize]) -> Result<(), String> {
        if let Some((first, rest)) = pattern.split_once('|') {
            return self.bind(first, shape).or_else(|_| self.bind(rest, shape));
        }
        let parts: Vec<&str> = if pattern.is_empty() { Vec::new() } else { pattern.split(',').collect() };
        let open = parts.last() == Some(&"...");
        let fixed = parts.len() - usize::from(open);
        let mut fits = if open { shape.len() >= fixed } else { shape.len() == fixed };
        let mut bound = self.0.clone();
        let mut same =
            |key: &str, sizes: &[usize]| *bound.entry(key.to_owned()).or_insert(sizes.to_vec()) == sizes;
        if fits {
            for (part, size) in parts[..fixed].iter().zip(shape) {
                fits &= part.parse::<usize>().map_or_else(|_| same(part, &[*size]), |n| n == *size);
            }
            fits &= !open || same("...", &shape[fixed..]);
        }
        if fits {
            self.0 = bound;
            return Ok(());
        }
        let with: Vec<String> = parts
            .iter()
            .filter_map(|part| self.0.get(*part).map(|sizes| format!("{part} = {}", list(sizes))))
            .collect();
        let with = if with.is_empty() { String::new() } else { format!(" with {}", with.join(", ")) };
        Err(format!("shape ({pattern}){with}"))
    }
}

/// An input as passed to a twin: an array, or `None` for an optional one that is absent.
pub trait Argument<'a, S>: Sized {
    /// Whether the input may be absent.
    const OPTIONAL: bool;
    /// The argument, `None` when it is missing.
    fn of(found: Option<&'a Arr<S>>) -> Option<Self>;
}

impl<'a, S> Argument<'a, S> for &'a Arr<S> {
    const OPTIONAL: bool = false;
    fn of(found: Option<&'a Arr<S>>) -> Option<Self> {
        found
    }
}

impl<'a, S> Argument<'a, S> for Option<&'a Arr<S>> {
    const OPTIONAL: bool = true;
    fn of(found: Option<&'a Arr<S>>) -> Option<Self> {
        Some(found)
    }
}

/// Returns one input after checking it against its port.
///
/// # Errors
/// When it is missing or has the wrong shape.
pub fn argument<'a, S: 'a, A: Argument<'a, S>>(
    port: &Port,
    find: &dyn Fn(&str) -> Option<&'a Arr<S>>,
    dims: &mut Dims,
) -> Result<A, String> {
    let found = find(port.name);
    if let Some(x) = found {
        let bound = dims.bind(port.shape, &x.shape);
        bound.map_err(|expected| {
            format!("input {}: expected {expected}, got ({})", port.name, list(&x.shape))
        })?;
    }
    A::of(found).ok_or_else(|| format!("input {} is missing", port.name))
}

/// Returns an optional input that is required in this mode of the operator.
///
/// # Errors
/// When it is absent.
pub fn required<'a, S>(name: &str, x: Option<&'a Arr<S>>) -> Result<&'a Arr<S>, String> {
    x.ok_or_else(|| format!("input {name} is missing"))
}

/// Declares the inputs of a twin: a struct with one field per input, each with its port. A field of type
/// `&'a Arr<S>` is required, one of type `Option<&'a Arr<S>>` may be absent. `PORTS` is the table of the
/// ports; `of` takes the inputs from named arrays and checks their shapes.
macro_rules! inputs {
    (
        $(#[$meta:meta])*
        pub struct $In:ident<'a, S> { $($name:ident: $kind:ty = $port:expr),* $(,)? }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug)]
        pub struct $In<'a, S> {
            $(#[doc = concat!("Input `", stringify!($name), "`.")] pub $name: $kind,)*
        }

        impl<'a, S> $In<'a, S> {
            /// The ports in the order of the fields.
            pub const PORTS: &'static [$crate::ports::Port] = &[$($crate::ports::Port {
                name: stringify!($name),
                optional: <$kind as $crate::inputs::Argument<'a, S>>::OPTIONAL,
                ..$port
            }),*];

            /// Looks up the inputs by the names of their ports.
            ///
            /// # Errors
            /// When one is missing or has the wrong shape.
            pub fn of(arrays: &'a $crate::array::Named<S>) -> Result<Self, String> {
                Self::bind(&|name| arrays.get(name))
            }

            /// Takes the inputs that `find` returns for the names of their ports.
            ///
            /// # Errors
            /// When one is missing or has the wrong shape.
            pub fn bind(
                find: &dyn Fn(&str) -> Option<&'a $crate::array::Arr<S>>,
            ) -> Result<Self, String> {
                let mut dims = $crate::inputs::Dims::default();
                let mut ports = Self::PORTS.iter();
                $(
                    let port = ports.next().expect("one port per field");
                    let $name: $kind = $crate::inputs::argument(port, find, &mut dims)?;
                )*
                Ok(Self { $($name),* })
            }
        }
    };
}
pub(crate) use inputs;
