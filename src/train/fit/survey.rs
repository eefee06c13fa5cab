//! A check of a capture before the first iteration: where its cameras point, and how many of its points each
//! of them sees.

use crate::num::order;
use crate::scene::bound::project;
use crate::scene::views::Views;
use serde_json::{Value, json};

/// A camera points at a place if the angle between its axis and the direction to the place has at least this
/// cosine.
const TOWARD: f64 = 0.3;

/// What a capture shows of its geometry.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Number of training images.
    pub images: usize,
    /// How many of them point at the centre of the scene box, the point nearest to all optical axes.
    pub inward: usize,
    /// Distances of the cameras from that centre: smallest and largest.
    pub distances: [f64; 2],
    /// Number of points of the capture.
    pub points: usize,
    /// Per training image: its name and the number of points inside the image, in the order of the images;
    /// empty without points.
    pub seen: Vec<(String, usize)>,
}

impl Survey {
    /// Measures the training images of a capture.
    pub fn of(views: &Views) -> Self {
        let center = views.scene_box.center;
        let points = views.points.as_ref().map_or(&[][..], |p| &p.xyz);
        let (mut inward, mut distances, mut seen) = (0, [f64::INFINITY, 0.0], Vec::new());
        for view in views.train.iter().map(|&i| &views.views[i]) {
            let camera = &view.camera;
            let eye = camera.center().map(f64::from);
            let to: [f64; 3] = std::array::from_fn(|k| center[k] - eye[k]);
            let length = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
            let along = (0..3).fold(0.0, |s, k| s + to[k] * f64::from(camera.rotation[2][k]));
            inward += usize::from(along > TOWARD * length);
            distances = [order::min(distances[0], length), order::max(distances[1], length)];
            if !points.is_empty() {
                let sides = [camera.width as f64, camera.height as f64];
                let is_inside = |p: &&[f64; 3]| {
                    project(camera, **p).is_some_and(|px| (0..2).all(|k| px[k] >= 0.0 && px[k] < sides[k]))
                };
                seen.push((view.name.clone(), points.iter().filter(is_inside).count()));
            }
        }
        Self { images: views.train.len(), inward, distances, points: points.len(), seen }
    }

    /// Whether most cameras look away from what they surround, as in a capture of a room from its middle.
    pub fn is_outward(&self) -> bool {
        self.images > 1 && 2 * self.inward < self.images
    }

    /// The numbers of points that the images see, in ascending order.
    pub fn counts(&self) -> Vec<usize> {
        let mut counts: Vec<usize> = self.seen.iter().map(|s| s.1).collect();
        counts.sort_unstable();
        counts
    }

    /// As a JSON record.
    pub fn json(&self) -> Value {
        let counts = self.counts();
        json!({
            "images": self.images, "cameras_pointing_inward": self.inward, "distances": self.distances, "points": self.points,
            "points_seen": {"least": counts.first(), "median": counts.get(counts.len() / 2), "most": counts.last()},
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::built_in;
    use crate::io::gaussian_ply::Points;
    use crate::splat::render::Settings;

    #[test]
    fn outward_looking_cameras_are_recognised() {
        let mut views = built_in::miniature(3, 8, &Settings::default()).expect("renders");
        let s = Survey::of(&views);
        assert_eq!(
            (s.images, s.inward, s.is_outward(), s.points),
            (7, 7, false, 0),
            "a circle around a scene"
        );
        assert!(s.distances[0] > 2.0 && s.distances[1] < 8.0, "{:?}", s.distances);
        let xyz = vec![[0.0, 0.0, 0.6], [0.1, 0.0, 0.6], [0.0, 0.0, 500.0]];
        views.points = Some(Points { rgb: vec![[0; 3]; 3], xyz });
        assert_eq!(Survey::of(&views).counts(), [2; 7], "two points are in the images, one is far above");
        for view in &mut views.views {
            // turned by half around its own vertical axis: right and forward change sign, the centre stays
            let c = &mut view.camera;
            for row in [0, 2] {
                c.rotation[row] = c.rotation[row].map(|x| -x);
                c.translation[row] = -c.translation[row];
            }
        }
        let s = Survey::of(&views);
        assert!(s.inward == 0 && s.is_outward() && s.counts() == [0; 7], "they look away: {s:?}");
    }
}
