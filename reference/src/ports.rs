//! Signatures of operators: the arrays that an operator reads and writes, and its settings.
//!
//! Every twin defines its [`Signature`] once, next to its equation. The twin binds its inputs with it; the
//! list of shipped operators uses the same table for its checks, documentation and files. A signature is
//! plain data.

/// Element type of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    /// f32 or f64, depending on the run.
    Float,
    /// Mask bytes.
    U8,
    /// Signs.
    I8,
    /// Indices.
    I32,
    /// Counts and offsets.
    I64,
}

impl Dtype {
    /// The name printed in lists.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Float => "float",
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::I32 => "i32",
            Self::I64 => "i64",
        }
    }
}

/// Which entries of an array `oracle compare` compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compare {
    /// Every entry.
    Values,
    /// Which entries are zero.
    ZeroPattern,
    /// Rows (the first two axes) in which the named array is nonzero in both files.
    RowsOf(&'static str),
}

/// The space in which finite differences perturb a parameter θ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// θ itself.
    Linear,
    /// ln θ, for positive quantities.
    Log,
    /// logit θ, for quantities from 0 to 1.
    Logit,
}

/// One input, output, intermediate or plan array.
#[derive(Clone, Copy, Debug)]
pub struct Port {
    /// Argument name.
    pub name: &'static str,
    /// Axes by letter or size, `...` for any further axes, `|` between alternatives; see
    /// [`crate::inputs::Dims`].
    pub shape: &'static str,
    /// Element type.
    pub dtype: Dtype,
    /// Whether the adjoint computes its gradient (inputs) or takes its cotangent (outputs).
    pub differentiable: bool,
    /// Whether it may be absent.
    pub optional: bool,
    /// One line of documentation.
    pub doc: &'static str,
    /// The space in which finite differences perturb it.
    pub space: Space,
    /// Which of its entries are compared.
    pub compare: Compare,
}

impl Port {
    /// Makes a port of a float array with a gradient. The macros `inputs!` and `ports!` set its name.
    pub const fn var(shape: &'static str, doc: &'static str) -> Self {
        Self {
            name: "",
            shape,
            dtype: Dtype::Float,
            differentiable: true,
            optional: false,
            doc,
            space: Space::Linear,
            compare: Compare::Values,
        }
    }

    /// Makes a port of a float array without a gradient.
    pub const fn fixed(shape: &'static str, doc: &'static str) -> Self {
        Self { differentiable: false, ..Self::var(shape, doc) }
    }

    /// Makes a port of an integer array.
    pub const fn int(shape: &'static str, dtype: Dtype, doc: &'static str) -> Self {
        Self { dtype, ..Self::fixed(shape, doc) }
    }

    /// Returns the port with a name that is not a Rust identifier.
    pub const fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    /// Returns the port as an optional one.
    pub const fn or_absent(self) -> Self {
        Self { optional: true, ..self }
    }

    /// Returns the port without a gradient.
    pub const fn without_gradient(self) -> Self {
        Self { differentiable: false, ..self }
    }

    /// Returns the port with another space for finite differences.
    pub const fn moved(self, space: Space) -> Self {
        Self { space, ..self }
    }

    /// Returns the port with another rule of comparison.
    pub const fn compared(self, compare: Compare) -> Self {
        Self { compare, ..self }
    }
}

/// Type of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A finite number.
    Number,
    /// 0 or 1.
    Flag,
    /// One of these words, or its index in the list.
    Choice(&'static [&'static str]),
}

/// One setting.
#[derive(Clone, Copy, Debug)]
pub struct SettingSpec {
    /// Name, as in `--set key=value` and in the array `setting_key`.
    pub key: &'static str,
    /// Admissible values.
    pub kind: Kind,
    /// Default as text; a phrase if it depends on other arguments.
    pub default: &'static str,
    /// One line of documentation.
    pub doc: &'static str,
}

impl SettingSpec {
    /// Defines a setting that is a number.
    pub const fn number(key: &'static str, default: &'static str, doc: &'static str) -> Self {
        Self { key, kind: Kind::Number, default, doc }
    }

    /// Defines a setting that is 0 or 1.
    pub const fn flag(key: &'static str, default: &'static str, doc: &'static str) -> Self {
        Self { key, kind: Kind::Flag, default, doc }
    }

    /// Defines a setting that is one of several words.
    pub const fn choice(
        key: &'static str,
        words: &'static [&'static str],
        default: &'static str,
        doc: &'static str,
    ) -> Self {
        Self { key, kind: Kind::Choice(words), default, doc }
    }
}

/// One operator inside a composite one, with the names of its arrays in files of the composite.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// Name of the operator; ` adjoint` is appended for its backward pass.
    pub operator: &'static str,
    /// Arrays it reads.
    pub inputs: &'static [&'static str],
    /// Arrays it writes.
    pub outputs: &'static [&'static str],
}

/// Names, shapes and documentation of all inputs and outputs of an operator.
#[derive(Clone, Copy, Debug)]
pub struct Signature {
    /// `group.name`
    pub name: &'static str,
    /// One line of documentation.
    pub summary: &'static str,
    /// Arguments, in the order of the operator's `In`.
    pub inputs: &'static [Port],
    /// Results.
    pub outputs: &'static [Port],
    /// Further results of `--dump`.
    pub intermediates: &'static [Port],
    /// Discrete decisions, in arrays of integers. An array of floats holds values that carry no gradient but change
    /// with the inputs: finite differences hold them, and they are no decisions.
    pub plan: &'static [Port],
    /// Names of this operator in files of other programs that are ignored.
    pub companions: &'static [&'static str],
    /// Settings.
    pub settings: &'static [SettingSpec],
    /// For a composite operator its parts, in order; else empty.
    pub stages: &'static [Stage],
}

impl Signature {
    /// A signature without a name and without ports, for struct update syntax.
    pub const EMPTY: Self = Self {
        name: "",
        summary: "",
        inputs: &[],
        outputs: &[],
        intermediates: &[],
        plan: &[],
        companions: &[],
        settings: &[],
        stages: &[],
    };

    /// Whether it is composed of several operators.
    pub fn is_composite(&self) -> bool {
        !self.stages.is_empty()
    }

    /// Whether `name` is an array of the plan whose values finite differences hold.
    pub fn is_held(&self, name: &str) -> bool {
        self.plan.iter().any(|port| port.name == name && port.dtype == Dtype::Float)
    }

    /// The port of that name among inputs, outputs, intermediates and plan.
    pub fn port(&self, name: &str) -> Option<&'static Port> {
        [self.inputs, self.outputs, self.intermediates, self.plan]
            .into_iter()
            .flatten()
            .find(|port| port.name == name)
    }

    /// Whether `name` is an input, an output, or an intermediate.
    pub fn has_array(&self, name: &str) -> bool {
        [self.inputs, self.outputs, self.intermediates].into_iter().flatten().any(|port| port.name == name)
    }

    /// Names of the inputs with a gradient, including optional ones.
    pub fn smooth_inputs(&self) -> Vec<&'static str> {
        self.inputs.iter().filter(|port| port.differentiable).map(|port| port.name).collect()
    }

    /// Names of the outputs for which the twin takes a cotangent: every float output of an operator with a
    /// gradient, including those of an inactive mode and those whose cotangent the shipped adjoint does not
    /// take.
    pub fn smooth_outputs(&self) -> Vec<&'static str> {
        let smooth = self.inputs.iter().any(|port| port.differentiable);
        let floats = self.outputs.iter().filter(|port| smooth && port.dtype == Dtype::Float);
        floats.map(|port| port.name).collect()
    }
}

/// A table of ports: `ports![y: Port::var("M,N", "")]`.
macro_rules! ports {
    ($($name:ident: $port:expr),* $(,)?) => {
        &[$($crate::ports::Port { name: stringify!($name), ..$port }),*]
    };
}
pub(crate) use ports;
