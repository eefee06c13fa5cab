//! What a configuration chooses among: how a state enters, coordinates of rays, backgrounds, first values.

/// How the state of the last set of images enters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fuse {
    /// The tokens are the output of the network alone.
    Published,
    /// The output of the network is added to the place tokens. It is 0 at first with the published first
    /// values, and half of the channels of the last state with the scaled ones.
    #[default]
    Residual,
}

impl Fuse {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Published, Self::Residual];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Published => "published",
            Self::Residual => "residual",
        }
    }

    /// Returns the one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|fuse| fuse.name() == name)
    }
}

/// The six coordinates in which a pixel's ray enters. Those of one kind follow from those of the other.
///
/// A token of a plane has to find the patches whose rays pass its column of space. The squared distance of a
/// point p from a ray is, but for a term with (p·d)², |c|² − 2 p·c + |p|²: with c in the token, the product
/// of a query and a key has the second term already. With the moment m, c = d × m is made of products of
/// coordinates, which layers have to learn first. A replica uses its cameras sooner with c; in the program's
/// own training c alone did not make it use its cameras (chapter `small_model` of the book).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rays {
    /// Unit direction d and moment m = o × d: Plücker coordinates, as published.
    Plucker,
    /// Unit direction d and the point of the ray's line nearest to the origin of the field, c = d × m.
    #[default]
    Nearest,
}

impl Rays {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Plucker, Self::Nearest];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plucker => "plucker",
            Self::Nearest => "nearest",
        }
    }

    /// Returns the one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|rays| rays.name() == name)
    }
}

/// What the images that a model reads have where the object is not.
///
/// A white background tells where an object ends unless its edge is bright. The foreground of the inputs is
/// known, so it need not be guessed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// White, 1 in the range of −1 to 1 of colours: as published.
    White,
    /// 3, which no colour is; a pixel that is covered in part has a mean by coverage.
    #[default]
    Marked,
}

impl Background {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::White, Self::Marked];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "white",
            Self::Marked => "marked",
        }
    }

    /// Returns the one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|background| background.name() == name)
    }
}

/// First values of weights and tokens.
///
/// The published ones suit a width of 1024 and a training of tens of thousands of steps. In a short training
/// of a narrow model they slow down the first hundreds of steps: a head without biases passes gradients on
/// times the product of its layers' gains (a thousandth for the four layers of a colour head at a gain of ¼),
/// weights of deviation 0.02 make the branches of a narrow block weak, and place tokens without any order
/// have to learn one by one where they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FirstValues {
    /// Heads with a gain of ¼, other weights with a deviation of 0.02, random place tokens.
    Published,
    /// Heads with a gain of ½ (distances, so that the first surface is about a ball, and normals, so that
    /// they are about radial) and 2, other weights with a deviation of 0.02·√(1024/D), less in the last
    /// layers of branches, place tokens that are projections of their positions ([`super::places`]), rays and
    /// texels as in the table of [`super::params`].
    #[default]
    Scaled,
}

impl FirstValues {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Published, Self::Scaled];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Published => "published",
            Self::Scaled => "scaled",
        }
    }

    /// Returns the one of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|g| g.name() == name)
    }

    /// Returns the gain of a head.
    pub(super) fn gain(self, head: &str) -> f32 {
        match self {
            Self::Published => 0.25,
            Self::Scaled if head == "sdf" || head == "normal" => 0.5,
            Self::Scaled => 2.0,
        }
    }

    /// Returns the deviation of other weights for a width.
    pub(super) fn deviation(self, width: usize) -> f64 {
        match self {
            Self::Published => 0.02,
            Self::Scaled => 0.02 * (1024.0 / width as f64).sqrt(),
        }
    }
}
