//! The discrete decisions of a render as arrays: which Gaussians, in which order, in which tiles.
//!
//! Cameras are concatenated in order; tiles are 16×16 pixels, TY×TX of them per camera, row-major.
//!
//! | name | shape | meaning |
//! |---|---|---|
//! | `order` | (V) | visible Gaussians of each camera by (z, index) |
//! | `camera_start` | (C+1) | where a camera's part of `order` starts |
//! | `tile_start` | (C·TY·TX+1) | where a tile's part of `tile_entry` starts |
//! | `tile_entry` | (E) | Gaussian index, in the order of the camera |
//! | `entry_slot` | (E) | emission slot: index of the entry when sorted by (camera, Gaussian, tile) |
//! | `last_index` | (C, H, W) | index in the tile's list of the last contributing Gaussian, −1: none |
//! | `alpha_mask`, `cap_mask` | (E, 32) | bit 16·row + column (bit b is bit b mod 8 of byte b div 8): contributes; α is capped |
//! | `t_clamp` | (C, N, 2) | side on which the Jacobian's tangents are limited |
//! | `color_mask` | (C, N, 3) | 1: the channel is not clamped at 0 |
//! | `pivot` | (C, N) | axis p of the conic |
//!
//! Every array in a given plan is used; missing ones are computed from the values.

use crate::array::{Arr, Named};
use crate::scene::profile::{Footprint, Profile};
use crate::splat::{blend, footprint};

/// Side of a tile in pixels.
pub const TILE: usize = 16;

fn whole_numbers(plan: &Named<f64>, name: &str) -> Result<Option<Vec<usize>>, String> {
    let Some(array) = plan.get(name) else { return Ok(None) };
    match array.data.iter().find(|&&x| !(x >= 0.0 && x.fract() == 0.0 && x < 9e15)) {
        Some(x) => Err(format!("plan {name}: expected whole numbers, got {x}")),
        None => Ok(Some(array.data.iter().map(|&x| x as usize).collect())),
    }
}

fn check_starts(name: &str, starts: &[usize], parts: usize, entries: usize) -> Result<(), String> {
    let ascending = starts.windows(2).all(|w| w[0] <= w[1]);
    if starts.len() == parts + 1 && ascending && starts[0] == 0 && starts[parts] == entries {
        return Ok(());
    }
    Err(format!(
        "plan {name}: expected {} ascending numbers from 0 to {entries}, got {} numbers",
        parts + 1,
        starts.len()
    ))
}

fn to_array(x: &[usize]) -> Arr<f64> {
    Arr::new(&[x.len()], x.iter().map(|&x| x as f64).collect())
}

/// `order` and `camera_start`.
pub struct Order {
    /// (V)
    pub order: Vec<usize>,
    /// (C+1)
    pub camera_start: Vec<usize>,
}

impl Order {
    /// Visible Gaussians of a camera, nearest first.
    pub fn of_camera(&self, c: usize) -> &[usize] {
        &self.order[self.camera_start[c]..self.camera_start[c + 1]]
    }
}

/// `order` and `camera_start` of a plan.
///
/// # Errors
/// When only one of them is present, or they do not match.
pub fn order(plan: Option<&Named<f64>>, views: usize, n: usize) -> Result<Option<Order>, String> {
    let Some(plan) = plan else { return Ok(None) };
    match (whole_numbers(plan, "order")?, whole_numbers(plan, "camera_start")?) {
        (None, None) => Ok(None),
        (Some(order), Some(camera_start)) => {
            check_starts("camera_start", &camera_start, views, order.len())?;
            if let Some(i) = order.iter().find(|&&i| i >= n) {
                return Err(format!("plan order: expected indices below {n}, got {i}"));
            }
            Ok(Some(Order { order, camera_start }))
        }
        _ => Err("plan: order and camera_start must be given together".to_owned()),
    }
}

/// Which Gaussians a plan draws, by row c·N + i.
///
/// # Errors
/// When the plan does not match.
pub fn visible(plan: Option<&Named<f64>>, views: usize, n: usize) -> Result<Option<Vec<bool>>, String> {
    Ok(order(plan, views, n)?.map(|order| {
        let mut visible = vec![false; views * n];
        for c in 0..views {
            for &i in order.of_camera(c) {
                visible[c * n + i] = true;
            }
        }
        visible
    }))
}

/// Checks the shapes of the arrays with one row per camera and Gaussian.
///
/// # Errors
/// Names the array that does not match.
pub fn check_rows(plan: Option<&Named<f64>>, views: usize, n: usize) -> Result<(), String> {
    let Some(plan) = plan else { return Ok(()) };
    for (name, shape, low, high) in [
        ("t_clamp", vec![views, n, 2], -1.0, 1.0),
        ("color_mask", vec![views, n, 3], 0.0, 1.0),
        ("pivot", vec![views, n], 0.0, 1.0),
    ] {
        let Some(array) = plan.get(name) else { continue };
        if array.shape != shape {
            return Err(format!("plan {name}: expected shape {shape:?}, got {:?}", array.shape));
        }
        if let Some(x) = array.data.iter().find(|&&x| !(x >= low && x <= high && x.fract() == 0.0)) {
            return Err(format!("plan {name}: expected whole numbers from {low} to {high}, got {x}"));
        }
    }
    Ok(())
}

/// Writes `order` and `camera_start`: the given ones, or all Gaussians with a depth sorted by (z, index).
pub fn write_order(
    plan: Option<&Named<f64>>,
    depths: &[Option<f64>],
    views: usize,
    n: usize,
    out: &mut Named<f64>,
) {
    if let Some((order, start)) = plan.and_then(|plan| plan.get("order").zip(plan.get("camera_start"))) {
        out.insert("order".to_owned(), order.clone());
        out.insert("camera_start".to_owned(), start.clone());
        return;
    }
    let (mut order, mut start) = (Vec::new(), vec![0]);
    for c in 0..views {
        let mut seen: Vec<(f64, usize)> =
            (0..n).filter_map(|i| depths[c * n + i].map(|z| (z + 0.0, i))).collect();
        seen.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        order.extend(seen.into_iter().map(|(_, i)| i));
        start.push(order.len());
    }
    out.insert("order".to_owned(), to_array(&order));
    out.insert("camera_start".to_owned(), to_array(&start));
}

/// The pixels that a Gaussian may affect, as columns and rows from..to: a superset of those with α ≥ α_min
/// under the alpha footprint, exactly the listed tiles under Inria's. Empty ranges: none.
pub fn reach(ellipse: &blend::Ellipse<f64>, size_px: [usize; 2], profile: &Profile) -> [[usize; 2]; 2] {
    let limit = |x: f64, size: usize| if x > 0.0 { (x as usize).min(size) } else { 0 };
    let [u, v] = ellipse.mean_px;
    match profile.footprint {
        Footprint::Inria => {
            let r = footprint::inria_radius(ellipse.shape, ellipse.axis);
            let side = TILE as f64;
            std::array::from_fn(|k| {
                let pixel = [u, v][k] - 0.5;
                let tiles = size_px[k].div_ceil(TILE);
                let low = limit(libm::floor((pixel - r) / side), tiles);
                let high = limit(libm::floor((pixel + r + side - 1.0) / side), tiles);
                [low * TILE, (high * TILE).min(size_px[k])]
            })
        }
        Footprint::Alpha if profile.alpha_min == 0.0 => [[0, size_px[0]], [0, size_px[1]]],
        Footprint::Alpha if ellipse.opacity < profile.alpha_min => [[0, 0], [0, 0]],
        Footprint::Alpha => {
            let [a, _, c] = footprint::covariance_of_shape(ellipse.shape, ellipse.axis);
            let extent = (2.0 * libm::log(ellipse.opacity / profile.alpha_min)).sqrt();
            std::array::from_fn(|k| {
                // Add one pixel on each side, and slightly more for huge ellipses; the α test makes the exact
                // decision.
                let half = extent * [a, c][k].sqrt() * (1.0 + 1e-9) + 1.0;
                let center = [u, v][k] - 0.5;
                [
                    limit(libm::floor(center - half), size_px[k]),
                    limit(libm::ceil(center + half) + 1.0, size_px[k]),
                ]
            })
        }
    }
}

/// Tile lists.
pub struct Lists {
    /// (C·TY·TX+1)
    pub tile_start: Vec<usize>,
    /// (E)
    pub tile_entry: Vec<usize>,
    /// (E)
    pub entry_slot: Vec<usize>,
}

impl Lists {
    /// The lists of the plan, or all tiles with at least one affected pixel.
    ///
    /// # Errors
    /// When the plan does not match.
    pub fn of(
        plan: Option<&Named<f64>>,
        order: &Order,
        x: &blend::Ellipses<'_, f64>,
        profile: &Profile,
    ) -> Result<Self, String> {
        let tiles = x.views * x.tiles()[0] * x.tiles()[1];
        if let Some(plan) = plan
            && let Some(tile_start) = whole_numbers(plan, "tile_start")?
        {
            let tile_entry = whole_numbers(plan, "tile_entry")?
                .ok_or("plan: tile_start and tile_entry must be given together")?;
            check_starts("tile_start", &tile_start, tiles, tile_entry.len())?;
            if let Some(i) = tile_entry.iter().find(|&&i| i >= x.n) {
                return Err(format!("plan tile_entry: expected indices below {}, got {i}", x.n));
            }
            let entry_slot = slots(&tile_start, &tile_entry, x);
            return Ok(Self { tile_start, tile_entry, entry_slot });
        }
        let mut lists = vec![Vec::new(); tiles];
        for c in 0..x.views {
            for &i in order.of_camera(c) {
                let ellipse = x.ellipse(c, i);
                let [columns, rows] = reach(&ellipse, x.size_px, profile);
                for py in rows[0]..rows[1] {
                    for px in columns[0]..columns[1] {
                        let list = &mut lists[x.tile(c, px, py)];
                        let reached = profile.footprint == Footprint::Inria
                            || ellipse.alpha([px as f64 + 0.5, py as f64 + 0.5]) >= profile.alpha_min;
                        if reached && list.last() != Some(&i) {
                            list.push(i);
                        }
                    }
                }
            }
        }
        let mut tile_start = vec![0];
        let mut tile_entry = Vec::new();
        for list in lists {
            tile_entry.extend(list);
            tile_start.push(tile_entry.len());
        }
        let entry_slot = slots(&tile_start, &tile_entry, x);
        Ok(Self { tile_start, tile_entry, entry_slot })
    }

    /// Writes `tile_start`, `tile_entry`, `entry_slot`.
    pub fn write(&self, out: &mut Named<f64>) {
        out.insert("tile_start".to_owned(), to_array(&self.tile_start));
        out.insert("tile_entry".to_owned(), to_array(&self.tile_entry));
        out.insert("entry_slot".to_owned(), to_array(&self.entry_slot));
    }
}

/// Emission slots: indices of the entries sorted by (camera, Gaussian, tile).
fn slots(tile_start: &[usize], tile_entry: &[usize], x: &blend::Ellipses<'_, f64>) -> Vec<usize> {
    let tiles_per_view = x.tiles()[0] * x.tiles()[1];
    let mut emitted = Vec::with_capacity(tile_entry.len());
    for tile in 0..tile_start.len() - 1 {
        for entry in tile_start[tile]..tile_start[tile + 1] {
            emitted.push((tile / tiles_per_view, tile_entry[entry], tile, entry));
        }
    }
    emitted.sort_unstable();
    let mut slots = vec![0; tile_entry.len()];
    for (slot, (.., entry)) in emitted.into_iter().enumerate() {
        slots[entry] = slot;
    }
    slots
}
