//! What both sides know of an operator: the arrays it reads and writes, and its settings.
//!
//! Every twin states its [`Signature`] once, beside its equation. The twin binds its inputs by it, the list of shipped
//! operators reads the same table for its checks, documentation and files. This is plain data.

/// Element type of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    /// f32 or f64, as the run.
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
    /// The name that lists show.
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
    /// Rows (the first two axes) where this other array is not zero in both files.
    RowsOf(&'static str),
}

/// The space in which finite differences move a parameter θ.
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
    /// Axes by letter or size, `...` for any further axes, `|` between alternatives; see [`crate::inputs::Dims`].
    pub shape: &'static str,
    /// Element type.
    pub dtype: Dtype,
    /// Whether the adjoint gives its gradient (inputs) or takes its cotangent (outputs).
    pub differentiable: bool,
    /// Whether it may be absent.
    pub optional: bool,
    /// One line of documentation.
    pub doc: &'static str,
    /// How finite differences move it.
    pub space: Space,
    /// How it is compared.
    pub compare: Compare,
}

impl Port {
    /// A float array with gradient. The macros `inputs!` and `ports!` give it its name.
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

    /// A float array without gradient.
    pub const fn fixed(shape: &'static str, doc: &'static str) -> Self {
        Self { differentiable: false, ..Self::var(shape, doc) }
    }

    /// An integer array.
    pub const fn int(shape: &'static str, dtype: Dtype, doc: &'static str) -> Self {
        Self { dtype, ..Self::fixed(shape, doc) }
    }

    /// The same port under a name that is no identifier.
    pub const fn named(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    /// The same port; it may be absent.
    pub const fn or_absent(self) -> Self {
        Self { optional: true, ..self }
    }

    /// The same port without gradient.
    pub const fn without_gradient(self) -> Self {
        Self { differentiable: false, ..self }
    }

    /// The same port, moved by finite differences in another space.
    pub const fn moved(self, space: Space) -> Self {
        Self { space, ..self }
    }

    /// The same port, compared otherwise.
    pub const fn compared(self, compare: Compare) -> Self {
        Self { compare, ..self }
    }
}

/// What a setting may be.
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
    /// Default as text; a phrase where it follows from other arguments.
    pub default: &'static str,
    /// One line of documentation.
    pub doc: &'static str,
}

impl SettingSpec {
    /// A number.
    pub const fn number(key: &'static str, default: &'static str, doc: &'static str) -> Self {
        Self { key, kind: Kind::Number, default, doc }
    }

    /// 0 or 1.
    pub const fn flag(key: &'static str, default: &'static str, doc: &'static str) -> Self {
        Self { key, kind: Kind::Flag, default, doc }
    }

    /// One of several words.
    pub const fn choice(
        key: &'static str,
        words: &'static [&'static str],
        default: &'static str,
        doc: &'static str,
    ) -> Self {
        Self { key, kind: Kind::Choice(words), default, doc }
    }
}

/// One operator inside a composite one, by the names its arrays have in files of the composite.
#[derive(Clone, Copy, Debug)]
pub struct Stage {
    /// Operator, with ` adjoint` for its reverse.
    pub operator: &'static str,
    /// Arrays it reads.
    pub inputs: &'static [&'static str],
    /// Arrays it writes.
    pub outputs: &'static [&'static str],
}

/// The names, shapes and documentation of everything that goes into an operator and comes out of it.
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
    /// Discrete decisions.
    pub plan: &'static [Port],
    /// Names in other programs' files that belong to this operator and are ignored.
    pub companions: &'static [&'static str],
    /// Settings.
    pub settings: &'static [SettingSpec],
    /// The operators it is made of, in order; empty for a single one.
    pub stages: &'static [Stage],
}

impl Signature {
    /// A signature without name and without ports, to be completed.
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

    /// Whether it is a chain of operators.
    pub fn is_composite(&self) -> bool {
        !self.stages.is_empty()
    }

    /// The port of that name among inputs, outputs, intermediates and plan.
    pub fn port(&self, name: &str) -> Option<&'static Port> {
        [self.inputs, self.outputs, self.intermediates, self.plan]
            .into_iter()
            .flatten()
            .find(|port| port.name == name)
    }

    /// Whether `name` is an input, an output, or an intermediate.
    pub fn knows(&self, name: &str) -> bool {
        [self.inputs, self.outputs, self.intermediates].into_iter().flatten().any(|port| port.name == name)
    }

    /// Names of the inputs with a gradient, optional ones included.
    pub fn smooth_inputs(&self) -> Vec<&'static str> {
        self.inputs.iter().filter(|port| port.differentiable).map(|port| port.name).collect()
    }

    /// Names of the outputs for which the twin takes a cotangent, those of a mode that is off included: every float
    /// output of an operator with a gradient, also one whose cotangent the shipped adjoint does not take.
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
