use super::super::figure::{Figure, Part};
use super::super::room::Vector;
use super::capsule::Capsule;
use super::gait::Pose;
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;

/// Height for which the measures below hold, in metres.
const OF_HEIGHT_M: f64 = 1.7;
/// Radius of the body for which its widths hold, in metres.
const OF_RADIUS_M: f64 = 0.2;
/// Heights of hips, knees, shoulders and hands, in metres.
const HIP_M: f64 = 0.86;
const KNEE_M: f64 = 0.48;
const SHOULDER_M: f64 = 1.36;
const HAND_M: f64 = 0.78;
/// How far hips and shoulders are from the axis, in metres.
const HIP_ASIDE_M: f64 = 0.09;
const SHOULDER_ASIDE_M: f64 = 0.14;
/// Radii of thighs, shanks, feet, trunk, shoulders, arms and head, in metres.
const THIGH_M: f64 = 0.085;
const SHANK_M: f64 = 0.06;
const FOOT_M: f64 = 0.045;
const TRUNK_M: f64 = 0.145;
const SHOULDERS_M: f64 = 0.09;
const ARM_M: f64 = 0.045;
const HEAD_M: f64 = 0.1;
/// Bottom of the trunk, below the hips, in metres: where the legs begin to be apart.
const CROTCH_M: f64 = 0.78;
/// Reflects as much as a shoe, whatever else somebody wears.
const SHOE: Rgb = [0.04, 0.035, 0.03];

/// A solid thing of the visible side: a person, or something on the floor.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::simulation) struct Body {
    /// What it is made of, each with its albedo.
    pub(super) capsules: Vec<(Capsule, Rgb)>,
    /// The same as upright cylinders, for light that comes from everywhere.
    pub(super) columns: Vec<(Part, Rgb)>,
    /// Contains all of it.
    pub(super) hull: Capsule,
}

/// Measures and colours of a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::simulation) struct Looks {
    pub(in crate::simulation) radius: f64,
    pub(in crate::simulation) height: f64,
    pub(in crate::simulation) clothes: Rgb,
    pub(in crate::simulation) trousers: Rgb,
    pub(in crate::simulation) skin: Rgb,
}

impl Body {
    /// A person.
    pub(in crate::simulation) fn person(looks: &Looks, pose: &Pose) -> Self {
        let (tall, wide) = (looks.height / OF_HEIGHT_M, looks.radius / OF_RADIUS_M);
        let [x, y] = pose.at;
        let [fx, fy] = pose.ahead;
        // `ahead` and `aside` of the axis, to the right, in metres.
        let place = |ahead: f64, aside: f64, up: f64| -> Vector {
            [x + ahead * fx + aside * fy, y + ahead * fy - aside * fx, up]
        };
        let limb = |from: Vector, to: Vector, radius: f64| Capsule { from, to, radius: radius * wide };
        let mut capsules = Vec::with_capacity(11);
        let mut columns = Vec::with_capacity(4);
        for (side, [before, lifted]) in [-1.0, 1.0].into_iter().zip(pose.feet) {
            let (before, lifted) = (before * tall, lifted * tall);
            let aside = side * HIP_ASIDE_M * wide;
            let hip = place(0.0, aside, HIP_M * tall);
            let ankle = place(before, aside, (FOOT_M + 0.02) * tall + lifted);
            // A knee bends as far as its foot is lifted.
            let knee = place(0.55 * before + 0.8 * lifted, aside, KNEE_M * tall + 0.4 * lifted);
            let (heel, toe) = (
                place(before - 0.05, aside, FOOT_M * wide + lifted),
                place(before + 0.14, aside, FOOT_M * wide + lifted),
            );
            capsules.push((limb(hip, knee, THIGH_M), looks.trousers));
            capsules.push((limb(knee, ankle, SHANK_M), looks.trousers));
            capsules.push((limb(heel, toe, FOOT_M), SHOE));
            let middle = place(0.5 * before, aside, 0.0);
            let radius = 0.5 * (THIGH_M + SHANK_M) * wide;
            let leg = Part { centre: [middle[0], middle[1]], radius, bottom: 0.0, top: CROTCH_M * tall };
            columns.push((leg, looks.trousers));
            let shoulder = place(0.0, side * (SHOULDER_ASIDE_M + SHOULDERS_M) * wide, SHOULDER_M * tall);
            // Arms swing against the legs.
            let hand =
                place(-0.6 * before, side * (SHOULDER_ASIDE_M + 0.12) * wide, HAND_M * tall + 0.1 * before.abs());
            capsules.push((limb(shoulder, hand, ARM_M), looks.clothes));
        }
        let trunk = limb(place(0.0, 0.0, (HIP_M + 0.08) * tall), place(0.0, 0.0, (SHOULDER_M - 0.1) * tall), TRUNK_M);
        let across = |aside: f64| place(0.0, aside * wide, SHOULDER_M * tall);
        let shoulders = limb(across(-SHOULDER_ASIDE_M), across(SHOULDER_ASIDE_M), SHOULDERS_M);
        let crown = looks.height - HEAD_M;
        let head = Capsule { from: place(0.02, 0.0, crown - 0.06), to: place(0.02, 0.0, crown), radius: HEAD_M };
        capsules.extend([(trunk, looks.clothes), (shoulders, looks.clothes), (head, looks.skin)]);
        let neck = (SHOULDER_M + SHOULDERS_M) * tall;
        let upper = Part { centre: pose.at, radius: 0.18 * wide, bottom: CROTCH_M * tall, top: neck };
        let top = Part { centre: pose.at, radius: HEAD_M, bottom: neck, top: looks.height };
        columns.extend([(upper, looks.clothes), (top, looks.skin)]);
        let reach = capsules
            .iter()
            .flat_map(|(c, _)| [c.from, c.to].map(|p| (p[0] - x).hypot(p[1] - y) + c.radius))
            .fold(0.0, f64::max);
        let hull = Capsule { from: [x, y, 0.0], to: [x, y, looks.height], radius: reach };
        Self { capsules, columns, hull }
    }

    /// A bag of that length, thickness and direction that lies on the floor.
    pub(in crate::simulation) fn bag(centre: Point, length: f64, thickness: f64, turn: f64, colour: Rgb) -> Self {
        let radius = thickness / 2.0;
        let half = (length / 2.0 - radius).max(0.0);
        let (sine, cosine) = turn.sin_cos();
        let end = |way: f64| [centre[0] + way * half * cosine, centre[1] + way * half * sine, radius];
        let capsule = Capsule { from: end(-1.0), to: end(1.0), radius };
        // As upright cylinders side by side along it.
        let count = 1 + (length / thickness).ceil().min(8.0) as usize;
        let column = |k: usize| {
            let [x, y, _] = end(2.0 * k as f64 / (count - 1).max(1) as f64 - 1.0);
            (Part { centre: [x, y], radius: 0.9 * radius, bottom: 0.0, top: 0.9 * thickness }, colour)
        };
        let hull = Capsule { from: capsule.from, to: capsule.to, radius };
        Self { capsules: vec![(capsule, colour)], columns: (0..count).map(column).collect(), hull }
    }

    /// What it is made of, each with its albedo.
    pub(in crate::simulation) fn capsules(&self) -> &[(Capsule, Rgb)] {
        &self.capsules
    }

    /// The same as upright cylinders.
    pub(in crate::simulation) fn columns(&self) -> &[(Part, Rgb)] {
        &self.columns
    }

    /// Its middle on the floor plan.
    pub(in crate::simulation) fn axis(&self) -> Point {
        let ([ax, ay, _], [bx, by, _]) = (self.hull.from, self.hull.to);
        [(ax + bx) / 2.0, (ay + by) / 2.0]
    }

    /// What the light of the hidden room meets.
    pub(in crate::simulation) fn figure(&self) -> Figure {
        Figure::of_parts(self.columns.clone())
    }
}
