//! How a model is scored: which objects and inputs, what is broken on purpose, and what can be answered
//! without images. [`super::evaluate`] does it.

use super::r#gen::{Lighting, Set, Settings, Version};
use super::model::decode::Rendering;
use super::reading::INPUT_SIDE;
use super::views::Views;
use crate::Result;
use crate::loss::metric::orb;
use crate::num::{order, par};

/// Pixels per side of an image that is rendered.
pub(super) const SIDE: usize = 128;
/// Training objects whose materials are averaged, and their images.
const MEANS: [u64; 2] = [24, 4];

/// Order of the inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Random.
    Random,
    /// By azimuth: every set shows one side.
    Sequential,
}

impl Order {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Random, Self::Sequential];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::Sequential => "sequential",
        }
    }

    /// Returns the order of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|order| order.name() == name)
    }
}

/// What is broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// Nothing.
    None,
    /// The state is zero before every set, which is then read as a first one: in the axes of its own images.
    ZeroedState,
    /// The images of every set have each other's cameras.
    PermutedCameras,
    /// From the second set on, the images show the next object.
    OtherObject,
    /// Red and green of all images are exchanged.
    SwappedColors,
    /// There is no state: after every set, all images so far are read in one round.
    AtOnce,
}

impl Control {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::None,
        Self::ZeroedState,
        Self::PermutedCameras,
        Self::OtherObject,
        Self::SwappedColors,
        Self::AtOnce,
    ];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::ZeroedState => "zeroed-state",
            Self::PermutedCameras => "permuted-cameras",
            Self::OtherObject => "other-object",
            Self::SwappedColors => "swapped-colors",
            Self::AtOnce => "at-once",
        }
    }

    /// Returns the control of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|control| control.name() == name)
    }
}

/// How a model is scored.
#[derive(Clone, Debug)]
pub struct Protocol {
    /// The test set.
    pub set: Settings,
    /// Version of the objects.
    pub version: Version,
    /// Order of the inputs.
    pub order: Order,
    /// How fields are rendered.
    pub rendering: Rendering,
    /// What is broken on purpose.
    pub control: Control,
    /// Sets that the model reads, of four (more are read as four).
    pub sets: usize,
    /// Outputs that are compared, of twelve.
    pub outputs: usize,
    /// Typical materials of training objects ([`typical_materials`]); `None` leaves the comparison out.
    pub typical: Option<Typical>,
    /// Whether the baselines are scored too.
    pub baselines: bool,
    /// Whether surfaces are compared.
    pub shapes: bool,
}

/// The settings of the test set of a seed.
pub fn settings(seed: u64, samples: u32) -> Settings {
    Settings {
        lighting: Lighting::Both,
        shiny: true,
        set: Set::Test,
        size: SIDE,
        samples,
        seed,
        ..Settings::default()
    }
}

/// Materials that can be answered without images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Typical {
    /// Mean albedo, of linear values, sRGB-encoded.
    pub albedo: [f32; 3],
    /// Means of roughness and metallic.
    pub mean: [f32; 2],
    /// Medians of both.
    pub median: [f32; 2],
}

/// Typical materials over the covered pixels of the first objects of a seed, in a version.
///
/// # Errors
/// If an object cannot be made.
pub fn typical_materials(seed: u64, version: Version) -> Result<Typical> {
    let [objects, images] = MEANS;
    let settings = Settings {
        lighting: Lighting::Both,
        shiny: true,
        size: INPUT_SIDE,
        samples: 1,
        views: images as usize,
        seed,
        ..Settings::default()
    };
    let made = par::map(objects as usize, |k| Views::rendered(&settings, k as u64, version));
    let (mut sums, mut all) = ([0.0; 5], [(); 2].map(|()| Vec::new()));
    for views in made {
        let views = views?;
        for target in (0..views.all.len()).map(|i| views.target(i)) {
            let (Some(albedo), Some(material)) = (&target.albedo, &target.material) else { continue };
            let covered = (0..target.foreground.len()).filter(|i| target.foreground[*i] == 1.0);
            for i in covered {
                let linear = |x: f32| orb::decode(f64::from(x));
                (0..3).for_each(|c| sums[c] += linear(albedo[3 * i + c]));
                for c in 0..2 {
                    sums[3 + c] += f64::from(material[2 * i + c]);
                    all[c].push(material[2 * i + c]);
                }
            }
        }
    }
    let mean = sums.map(|s: f64| s / order::max(all[0].len() as f64, 1.0));
    let encoded = |x: f64| orb::encode(x) as f32;
    let median = all.map(|mut x| {
        x.sort_unstable_by(f32::total_cmp);
        x.get(x.len() / 2).copied().unwrap_or_default()
    });
    Ok(Typical {
        albedo: std::array::from_fn(|c| encoded(mean[c])),
        mean: std::array::from_fn(|c| mean[3 + c] as f32),
        median,
    })
}
