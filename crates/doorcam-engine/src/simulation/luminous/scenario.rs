use super::direct::{Cylinder, Wall};
use super::{Sensor, Walk};
use doorcam_core::geometry::{Doorway, Room};
use doorcam_core::scene::Rgb;
use doorcam_core::transport::{PatchGrid, PixelLayout};

/// A person who walks: a vertical cylinder that shines evenly.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// Id in the truth.
    pub id: u64,
    /// Radius, in metres.
    pub radius_m: f64,
    /// Height, in metres.
    pub height_m: f64,
    /// Radiance: light on the floor per steradian (weighted by the cosine law), relative to full scale.
    pub radiance: Rgb,
    /// Where it goes.
    pub walk: Walk,
}

/// Everything that a simulated recording shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// The doorway.
    pub doorway: Doorway,
    /// The hidden room; people outside it are not in the truth.
    pub room: Room,
    /// What stands still on the hidden side.
    pub walls: Vec<Wall>,
    /// The people who walk there.
    pub people: Vec<Person>,
    /// Light on the floor from the visible side, uniform and constant, relative to full scale.
    pub visible_light: Rgb,
    /// The floor patches.
    pub patch: PatchGrid,
    /// The camera.
    pub sensor: Sensor,
    /// Frames per second.
    pub fps: f64,
    /// Frames at the start that show the room without people; the walks start after them.
    pub background_frames: u64,
}

impl Scenario {
    /// Number of frames in one round of [`Scenario::demo`], after which a loop continues without a jump.
    pub const DEMO_FRAMES: u64 = 210;

    /// Two people, one warm red and one blue, who come in through opposite side walls, pass each other twice at
    /// different depths and leave again.
    ///
    /// A person changes the light on the floor by up to 4 to 9 percent, depending on their position. They are brighter
    /// than what is behind them, so nearly every change is positive, and the room is as bright as the camera allows: a
    /// fixed λ assumes a level of light, and a dimmer room is drawn towards the door.
    pub fn demo() -> Self {
        let (half, depth) = (1.5, 3.0);
        let wall = |from, to, radiance| Wall { from, to, height_m: 2.4, radiance };
        let pale = [0.060, 0.058, 0.054];
        Self {
            doorway: Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None },
            room: Room { half_width_m: half, depth_m: depth },
            walls: vec![
                wall([-half, 0.0], [-half, depth], [0.048, 0.054, 0.060]),
                wall([-half, depth], [0.3, depth], pale),
                // A window behind a curtain.
                wall([0.3, depth], [0.9, depth], [0.100, 0.106, 0.112]),
                wall([0.9, depth], [half, depth], pale),
                wall([half, depth], [half, 0.0], [0.060, 0.052, 0.044]),
            ],
            people: vec![
                Person {
                    id: 1,
                    radius_m: 0.20,
                    height_m: 1.80,
                    radiance: [0.52, 0.17, 0.13],
                    walk: Walk {
                        waypoints: vec![
                            (0.0, [2.0, 1.2]),
                            (1.4, [0.8, 1.2]),
                            (3.6, [0.2, 0.95]),
                            (6.2, [-0.55, 1.0]),
                            (8.6, [-0.35, 1.5]),
                            (11.2, [0.5, 1.5]),
                            (13.6, [0.45, 1.0]),
                            (15.2, [0.9, 1.05]),
                            (16.2, [2.0, 1.2]),
                        ],
                        period_s: Some(20.0),
                    },
                },
                Person {
                    id: 2,
                    radius_m: 0.18,
                    height_m: 1.65,
                    radiance: [0.13, 0.20, 0.52],
                    walk: Walk {
                        waypoints: vec![
                            (0.0, [-2.0, 1.3]),
                            (3.2, [-2.0, 1.3]),
                            (4.6, [-0.7, 1.45]),
                            (6.8, [0.3, 1.5]),
                            (9.2, [0.55, 0.95]),
                            (11.6, [-0.2, 0.95]),
                            (14.0, [-0.55, 1.4]),
                            (16.2, [0.1, 1.3]),
                            (18.2, [-0.7, 1.0]),
                            (19.2, [-2.0, 1.2]),
                        ],
                        period_s: Some(20.0),
                    },
                },
            ],
            visible_light: [0.80, 0.80, 0.80],
            patch: PatchGrid { size: 64, fov_m: 0.30, layout: PixelLayout::Cells },
            // Noise of 0.4 percent of the level.
            sensor: Sensor { full_scale_electrons: 80_000.0, read_electrons: 30.0 },
            fps: 10.0,
            background_frames: 10,
        }
    }

    /// Time of a frame since the start of the recording, in seconds.
    pub fn seconds(&self, frame: u64) -> f64 {
        frame as f64 / self.fps
    }

    /// The people in a frame with their cylinders, in the order of [`Scenario::people`]; nobody in the background
    /// frames.
    pub fn people_in(&self, frame: u64) -> Vec<(&Person, Cylinder)> {
        let Some(walked) = frame.checked_sub(self.background_frames) else {
            return Vec::new();
        };
        let seconds = self.seconds(walked);
        let placed = |person: &Person| {
            let &Person { radius_m, height_m, radiance, .. } = person;
            Some(Cylinder { centre: person.walk.at(seconds)?, radius_m, height_m, radiance })
        };
        self.people.iter().filter_map(|person| Some((person, placed(person)?))).collect()
    }

    /// Whether a point is inside the room.
    pub(super) fn is_inside(&self, [x, y]: doorcam_core::geometry::Point) -> bool {
        x.abs() < self.room.half_width_m && (0.0..self.room.depth_m).contains(&y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demo_starts_and_ends_with_nobody_and_people_keep_their_distance() {
        let demo = Scenario::demo();
        let inside = |frame| {
            let there = demo
                .people_in(frame)
                .into_iter()
                .filter(|(p, c)| c.centre[0].abs() < demo.room.half_width_m + p.radius_m);
            there.count()
        };
        let counts: Vec<usize> = (0..Scenario::DEMO_FRAMES).map(inside).collect();
        let last = counts.len() - 1;
        assert_eq!([counts[9], counts[10], counts[last]], [0, 0, 0]);
        for people in [1, 2] {
            assert!(counts.iter().filter(|&&c| c == people).count() > 20, "{people} people");
        }
        for frame in demo.background_frames..Scenario::DEMO_FRAMES {
            let people = demo.people_in(frame);
            let [(_, a), (_, b)] = people[..] else { panic!("two people") };
            let apart = (a.centre[0] - b.centre[0]).hypot(a.centre[1] - b.centre[1]);
            assert!(apart > a.radius_m + b.radius_m + 0.15, "frame {frame}: {apart} m apart");
            for c in [a, b] {
                assert!(c.centre[1] > c.radius_m + 0.3 && c.centre[1] < demo.room.depth_m - c.radius_m);
            }
        }
    }
}
