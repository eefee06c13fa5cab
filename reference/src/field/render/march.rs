//! Rays: where they cross the box, their steps, and the sums along them.

use super::field::Field;
use crate::array::Named;
use crate::scalar::Scalar;

/// Distances at which a ray enters and leaves the box; entry ≥ exit if it misses.
pub(super) fn crossing(origin: [f64; 3], direction: [f64; 3], half_size: f64) -> [f64; 2] {
    let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
    for k in 0..3 {
        if direction[k] == 0.0 {
            if origin[k].abs() > half_size {
                return [1.0, 0.0];
            }
        } else {
            let a = (-half_size - origin[k]) / direction[k];
            let b = (half_size - origin[k]) / direction[k];
            let (near, far) = if a < b { (a, b) } else { (b, a) };
            enter = if near > enter { near } else { enter };
            leave = if far < leave { far } else { leave };
        }
    }
    [enter, leave]
}

/// Steps of a ray: those of the plan, or all that begin before it leaves the box.
pub(super) fn steps(
    plan: Option<&Named<f64>>,
    ray: usize,
    [enter, leave]: [f64; 2],
    step: f64,
) -> Vec<usize> {
    if let Some((start, index)) = plan.and_then(|p| Some((p.get("start")?, p.get("index")?))) {
        let (from, to) = (start.data[ray] as usize, start.data[ray + 1] as usize);
        return index.data[from..to].iter().map(|i| *i as usize).collect();
    }
    let mut all = Vec::new();
    while enter + all.len() as f64 * step < leave {
        all.push(all.len());
    }
    all
}

/// Sums along one ray.
pub(super) struct Sums<S> {
    /// Transmittance behind the last sample.
    pub(super) through: S,
    /// Σ w of the samples that have the background's values.
    pub(super) unshaded: S,
    pub(super) opacity: S,
    pub(super) values: Vec<(&'static str, Vec<S>)>,
    pub(super) point: [S; 3],
    pub(super) normal: [S; 3],
    pub(super) taken: usize,
    /// Per step: 1 if its values are decoded.
    pub(super) shaded: Vec<f64>,
}

/// Composites the samples of a ray.
pub(super) fn march<S: Scalar>(
    field: &mut Field<'_, S>,
    (origin, direction): ([f64; 3], [f64; 3]),
    ([enter, leave], steps): ([f64; 2], &[usize]),
    (taken, shaded): (Option<usize>, Option<&[f64]>),
) -> Sums<S> {
    let beta = field.input.beta.data[0];
    let at = |t: f64| std::array::from_fn(|k| origin[k] + t * direction[k]);
    let mut sums = Sums {
        through: S::one(),
        unshaded: S::zero(),
        opacity: S::zero(),
        values: Vec::new(),
        point: [S::zero(); 3],
        normal: [S::zero(); 3],
        taken: 0,
        shaded: vec![0.0; steps.len()],
    };
    for i in steps {
        if taken == Some(sums.taken) {
            break;
        }
        let begin = enter + *i as f64 * field.choices.step;
        let end = enter + (*i + 1) as f64 * field.choices.step;
        let end = if leave < end { leave } else { end };
        let sigma = field.density(at, [begin, end], beta);
        let kept = (-(sigma * (end - begin))).exp();
        let weight = sums.through * (-(-(sigma * (end - begin))).expm1());
        let middle: [f64; 3] = at(begin + (end - begin) / 2.0);
        sums.opacity = sums.opacity + weight;
        let least = field.choices.least_weight;
        let counts = least == 0.0 || weight.value() >= least || field.heads.is_trunk();
        if shaded.map_or(counts, |all| all[sums.taken] != 0.0) {
            sums.shaded[sums.taken] = 1.0;
            let values = field.values(middle, direction);
            if sums.values.is_empty() {
                sums.values = values.iter().map(|(name, v)| (*name, vec![S::zero(); v.len()])).collect();
            }
            for ((_, sum), (_, value)) in sums.values.iter_mut().zip(values) {
                for (sum, v) in sum.iter_mut().zip(value) {
                    *sum = *sum + weight * v;
                }
            }
        } else {
            sums.unshaded = sums.unshaded + weight;
        }
        for k in 0..3 {
            sums.point[k] = sums.point[k] + weight * middle[k];
        }
        if field.choices.normals != "none" {
            let n = field.numerical_normal(middle);
            for k in 0..3 {
                sums.normal[k] = sums.normal[k] + weight * n[k];
            }
        }
        sums.through = sums.through * kept;
        sums.taken += 1;
        if taken.is_none()
            && field.choices.early_stop > 0.0
            && sums.through.value() <= field.choices.early_stop
        {
            break;
        }
    }
    sums
}
