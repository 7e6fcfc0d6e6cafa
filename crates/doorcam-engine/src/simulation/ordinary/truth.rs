use serde::Serialize;

use super::super::scenario::{LampSpec, PersonSpec, Scenario};
use super::spec::{FurnitureSpec, LeafSpec, TelevisionSpec, WindowSpec};
use doorcam_core::scene::Rgb;

/// What `truth.json` tells of an ordinary room, under `room`: the scenario's keys, as docs/simulator.md describes them.
#[derive(Debug, Clone, Serialize)]
pub(in crate::simulation) struct TrueRoom<'a> {
    half_width_m: f64,
    depth_m: f64,
    ceiling_m: f64,
    lamps: &'a [LampSpec],
    windows: &'a [WindowSpec],
    televisions: &'a [TelevisionSpec],
    furniture: &'a [FurnitureSpec],
    leaf: Option<LeafSpec>,
    gloss: f64,
    /// Whether the floor beside the edges sees a light itself.
    light_seen: bool,
    people: Vec<TruePerson>,
}

#[derive(Debug, Clone, Serialize)]
struct TruePerson {
    id: u64,
    height_m: f64,
    limbs: bool,
    clothes: Rgb,
    trousers: Option<Rgb>,
}

impl<'a> TrueRoom<'a> {
    pub(in crate::simulation) fn new(scenario: &'a Scenario, light_seen: bool) -> Self {
        let person = |(id, person): (u64, &PersonSpec)| TruePerson {
            id,
            height_m: person.height_m,
            limbs: person.limbs,
            clothes: person.clothes,
            trousers: person.trousers,
        };
        let room = &scenario.room;
        Self {
            half_width_m: room.half_width_m,
            depth_m: room.depth_m,
            ceiling_m: room.ceiling_m,
            lamps: &scenario.lamp,
            windows: &scenario.window,
            televisions: &scenario.television,
            furniture: &scenario.furniture,
            leaf: scenario.leaf,
            gloss: scenario.floor.gloss,
            light_seen,
            people: (1..).zip(&scenario.person).map(person).collect(),
        }
    }
}
