//! The adjoint of `nn.conv`; the equations and the rounding are documented in [`super`].

use super::{In, InBar, PADDED, PIXELS, Shape, Window, checked, items, sized};
use crate::num::gemm::runs::{Grid, Runs, add_grids, gemm_runs};
use crate::num::gemm::{Finish, Packed, View};
use crate::num::{order, par};

/// Number of tasks that share the kernel entries in the gradient of the weight.
const SHARES: usize = 8;
/// Rows of a register tile; each task gets a multiple of it.
const TILE: usize = 6;
/// Largest number of items prepared together for the gradient of the weight, so that a few threads have
/// several each.
const ITEMS: usize = 16;
/// Approximate number of values in these items, if there is more than one.
const HELD: usize = 1 << 20;

/// Cotangent of a convolution, with the leaky ReLU that followed, if any.
#[derive(Clone, Copy)]
struct Cotangent<'a> {
    y_bar: &'a [f32],
    /// Results of the leaky ReLU and its slope.
    after: Option<(&'a [f32], f32)>,
}

impl Cotangent<'_> {
    #[inline(always)]
    fn read(&self, first: usize, into: &mut [f32]) {
        let y_bar = &self.y_bar[first..][..into.len()];
        match self.after {
            None => into.copy_from_slice(y_bar),
            Some((y, slope)) => {
                for (into, (y, bar)) in into.iter_mut().zip(y[first..].iter().zip(y_bar)) {
                    *into = if *y > 0.0 { *bar } else { slope * *bar };
                }
            }
        }
    }
}

/// Adds the gradients for the cotangent `y_bar` (B, H', W', O) to `x_bar`.
///
/// # Panics
/// Panics if the kernel does not fit, there is no channel, or a buffer does not have the size of its shape.
pub fn adjoint(x: In<'_>, y_bar: &[f32], x_bar: &mut InBar) {
    gradients(&x, Cotangent { y_bar, after: None }, Finish::Add, x_bar);
}

/// Returns the gradients of [`forward_leaky`](super::forward_leaky) with result `y` for those of x, weight
/// and bias that are `wanted`; the others are empty. The slope is ≥ 0, so that the sign of y determines the
/// branch.
///
/// # Panics
/// Panics under the conditions of [`adjoint`]; also panics if the slope is negative.
pub fn gradients_leaky(x: In<'_>, slope: f32, y: &[f32], y_bar: &[f32], wanted: [bool; 3]) -> InBar {
    assert!(slope >= 0.0, "the slope is not negative");
    assert_eq!(y.len(), y_bar.len(), "the cotangent has the size of y");
    let room = |is_wanted: bool, len: usize| if is_wanted { vec![0.0; len] } else { Vec::new() };
    let mut bar = InBar {
        x: room(wanted[0], x.x.len()),
        weight: room(wanted[1], x.weight.len()),
        bias: room(wanted[2], x.bias.len()),
    };
    // Freshly allocated zero pages are not touched before they are written.
    gradients(&x, Cotangent { y_bar, after: Some((y, slope)) }, Finish::AddToZero, &mut bar);
    bar
}

/// Writes the transposed convolution x (B, H, W, C) of `y` (B, H', W', O) without overlap: the sum of x̄ in [`super`] with y
/// for z̄, to which `bias` (C) is added.
///
/// # Panics
/// Panics if the kernel is not as large as the stride, an entry of x is read by no output, or a buffer does not have the size
/// of its shape.
pub(in crate::nn) fn transposed(y: &[f32], weight: &[f32], bias: &[f32], shape: Shape, x: &mut [f32]) {
    let [rows, columns] = shape.fitting();
    let (sides, stride) = ([shape.height, shape.width], shape.stride);
    assert!(shape.kernel == [stride; 2] && shape.pad == 0, "patches that do not overlap");
    assert_eq!(sides, [rows * stride, columns * stride], "outputs read every entry");
    assert_eq!(y.len(), shape.batch * rows * columns * shape.outputs, "y has the size of its shape");
    assert_eq!(weight.len(), shape.outputs * shape.taps(), "the weight has the size of its shape");
    picture(&In { x: &[], weight, bias, shape }, Cotangent { y_bar: y, after: None }, Finish::Bias(bias), x);
}

/// Computes the gradients; `how` defines how the gradient of the images is combined with existing values.
fn gradients(x: &In<'_>, cotangent: Cotangent<'_>, how: Finish<'_>, x_bar: &mut InBar) {
    let [rows, columns] = checked(x);
    let size = x.shape.batch * rows * columns * x.shape.outputs;
    assert_eq!(cotangent.y_bar.len(), size, "the cotangent has the size of y");
    if size == 0 {
        return;
    }
    if !x_bar.x.is_empty() {
        picture(x, cotangent, how, &mut x_bar.x);
    }
    if !x_bar.weight.is_empty() || !x_bar.bias.is_empty() {
        filters(x, cotangent, &mut x_bar.weight, &mut x_bar.bias);
    }
}

/// Data of one item that the gradients of weight and bias need.
#[derive(Default)]
struct Item {
    /// The image surrounded by zeros, followed by as many extra numbers as the distance between two patches.
    padded: Vec<f32>,
    /// Cotangent ȳ, shape (H'·W', O).
    cotangent: Packed,
    /// Gradient of the bias, a left fold over the pixels.
    sums: Vec<f32>,
}

impl Item {
    fn made_ready(mut self, x: &In<'_>, cotangent: Cotangent<'_>, b: usize, window: &Window) -> Self {
        let Shape { height, width, channels, outputs, stride, .. } = x.shape;
        let [rows, columns] = x.shape.fitting();
        self.padded = sized(self.padded, (window.pixels() + stride) * channels);
        let picture = &x.x[b * height * width * channels..][..height * width * channels];
        window.copy([height, width, channels], &mut self.padded, |first, into| {
            into.copy_from_slice(&picture[first..][..into.len()]);
        });
        let size = rows * columns * outputs;
        self.cotangent =
            self.cotangent.renewed((rows * columns, outputs), |at, into| cotangent.read(b * size + at, into));
        self.sums.clear();
        self.sums.extend(self.cotangent.column_sums());
        self
    }
}

/// Computes W̄ and β̄: a few items at a time are prepared; then each task owns some entries (i, j, c) of the
/// kernel for all outputs and processes the items in order.
fn filters(x: &In<'_>, cotangent: Cotangent<'_>, weight_bar: &mut [f32], bias_bar: &mut [f32]) {
    let Shape { batch, channels, outputs, kernel: [kh, kw], stride, pad, .. } = x.shape;
    let ([rows, columns], taps) = (x.shape.fitting(), x.shape.taps());
    assert!(weight_bar.is_empty() || weight_bar.len() == outputs * taps, "one gradient per weight");
    assert!(bias_bar.is_empty() || bias_bar.len() == outputs, "one gradient per bias");
    let reach = |outputs: usize, kernel: usize| {
        -(pad as isize)..((outputs - 1) * stride + kernel) as isize - pad as isize
    };
    let window = Window { rows: reach(rows, kh), columns: reach(columns, kw) };
    let line = window.width() * channels;
    let offsets: Vec<usize> = (0..kh).map(|i| i * line).collect();
    // Sums in shape (taps, O), the transpose of the caller's layout.
    let mut sums: Vec<f32> =
        (0..weight_bar.len()).map(|at| weight_bar[at % outputs * taps + at / outputs]).collect();
    let share = taps.div_ceil(SHARES).next_multiple_of(TILE);
    let numbers = window.pixels() * channels + rows * columns * outputs;
    let at_once = order::clamp(HELD / numbers, 1, order::min(ITEMS, batch));
    let mut held: Vec<Item> = (0..at_once).map(|_| Item::default()).collect();
    for first in (0..batch).step_by(at_once) {
        held.truncate(batch - first);
        held = par::map_each(held, |i, item| item.made_ready(x, cotangent, first + i, &window));
        let patches: Vec<(Grid<'_>, &Packed)> = held
            .iter()
            .map(|item| {
                let patches = Grid {
                    values: &item.padded,
                    rows,
                    columns,
                    down: stride * line,
                    along: stride * channels,
                    offsets: &offsets,
                    len: kw * channels,
                };
                (patches, &item.cotangent)
            })
            .collect();
        par::chunks_mut(&mut sums, share * outputs, |task, sums| {
            add_grids(&patches, task * share, sums.chunks_exact_mut(outputs).collect());
        });
        for item in &held {
            bias_bar.iter_mut().zip(&item.sums).for_each(|(bar, sum)| *bar += *sum);
        }
    }
    for (at, bar) in weight_bar.iter_mut().enumerate() {
        *bar = sums[at % taps * outputs + at / taps];
    }
}

/// The taps that pixels of one class use: those with i ≡ `phase[0]`, j ≡ `phase[1]` (mod s).
struct Class {
    phase: [usize; 2],
    /// Number of such i and j.
    count: [usize; 2],
    /// Weights in shape (count·O, C), with rows in the order (i, j, o).
    weight: Packed,
}

fn classes(x: &In<'_>) -> Vec<Class> {
    let Shape { channels, outputs, kernel: [kh, kw], stride, .. } = x.shape;
    let mut classes = Vec::new();
    for phase in (0..stride * stride).map(|k| [k / stride, k % stride]) {
        let [is, js] = [(phase[0]..kh).step_by(stride), (phase[1]..kw).step_by(stride)];
        let count = [is.len(), js.len()];
        if count[0] * count[1] == 0 {
            continue; // no output reads these pixels
        }
        let mut rows = Vec::with_capacity(count[0] * count[1] * outputs * channels);
        for i in is {
            for j in js.clone() {
                for o in 0..outputs {
                    rows.extend_from_slice(&x.weight[((o * kh + i) * kw + j) * channels..][..channels]);
                }
            }
        }
        let weight = Packed::new(View::new(&rows, count[0] * count[1] * outputs, channels));
        classes.push(Class { phase, count, weight });
    }
    classes
}

/// Computes x̄: each task owns some rows of pixels and processes them class by class.
fn picture(x: &In<'_>, cotangent: Cotangent<'_>, how: Finish<'_>, bar: &mut [f32]) {
    let Shape { batch, height, width, channels, outputs, kernel: [kh, kw], stride, pad } = x.shape;
    assert_eq!(bar.len(), batch * height * width * channels, "one gradient per value of x");
    if bar.is_empty() {
        return;
    }
    let [rows, columns] = x.shape.fitting();
    let classes = classes(x);
    let lines = order::max(1, PIXELS * stride * stride / width);
    // The first tap of a class uses output (h + p)/s, and each further tap the output before.
    let [above, before] = [kh, kw].map(|taps| taps.div_ceil(stride) - 1);
    let wide = -(before as isize)..((width - 1 + pad) / stride + 1) as isize;
    let line = wide.len() * outputs;
    par::chunks_mut(bar, lines * width * channels, |task, bar| {
        let mut padded = PADDED.take();
        let (mut used, mut begins) = (0, Vec::new());
        let mine = task * lines..task * lines + bar.len() / (width * channels);
        for (b, mine) in items(mine, height) {
            let [top, bottom] = [mine.start, mine.end - 1].map(|h| ((h + pad) / stride) as isize);
            let window = Window { rows: top - above as isize..bottom + 1, columns: wide.clone() };
            padded = sized(padded, used + window.pixels() * outputs);
            let first = b * rows * columns * outputs;
            window.copy([rows, columns, outputs], &mut padded[used..], |at, into| {
                cotangent.read(first + at, into);
            });
            begins.extend(mine.map(|h| (h, used + ((h + pad) / stride - top.unsigned_abs()) * line)));
            used += window.pixels() * outputs;
        }
        // Pixels of each class among those of this task: their start, and the location of their gradients.
        let mut pixels: Vec<(Vec<usize>, Vec<&mut [f32]>)> =
            classes.iter().map(|_| Default::default()).collect();
        let class: Vec<Option<usize>> = (0..stride * stride)
            .map(|k| classes.iter().position(|class| class.phase == [k / stride, k % stride]))
            .collect();
        for (bar, (h, begin)) in bar.chunks_exact_mut(width * channels).zip(begins) {
            let phase = (h + pad) % stride * stride;
            for (w, bar) in bar.chunks_exact_mut(channels).enumerate() {
                if let Some(class) = class[phase + (w + pad) % stride] {
                    pixels[class].0.push(begin + (w + pad) / stride * outputs);
                    pixels[class].1.push(bar);
                }
            }
        }
        for (class, (starts, bars)) in classes.iter().zip(pixels) {
            let offset = |tap: usize| {
                let [i, j] = [tap / class.count[1], tap % class.count[1]];
                (above - i) * line + (before - j) * outputs
            };
            let offsets: Vec<usize> = (0..class.count[0] * class.count[1]).map(offset).collect();
            let seen = Runs { values: &padded[..used], starts: &starts, offsets: &offsets, len: outputs };
            gemm_runs(seen, &class.weight, how, bars);
        }
        PADDED.set(padded);
    });
}
