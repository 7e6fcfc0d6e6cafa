//! A doorway whose truth is known, rendered without the reconstruction's own matrix (docs/simulator.md).
//!
//! The reconstruction knows flat facets on a grid. Here the hidden room is continuous: lamps light walls with panels on them, the
//! ceiling and people anywhere, who throw shadows and hide walls, lamps and each other; what of it is seen through the opening
//! lights the floor, which a camera with noise looks at. A [`Scenario`] says what there is and how it moves, a [`Simulator`]
//! makes any frame of it, [`record_simulation`] a recording with truth, [`LiveSimulation`] a live source.
//!
//! [`luminous`] is a plainer world for tests.

mod check;
mod exposure;
mod figure;
mod floor;
mod lamp;
mod light;
mod live;
pub mod luminous;
mod recording;
mod room;
mod scenario;
mod simulator;
mod view;
mod walk;

pub use live::{LiveOptions, LiveSimulation};
pub use recording::{SimulationError, record_simulation};
pub use scenario::{
    CameraSpec, FlickerSpec, FloorSpec, FrameFormat, LampKind, LampSpec, PanelSpec, PersonSpec, RoomAlbedo, RoomSpec,
    Scenario, ScenarioError, VisibleSpec, WallName,
};
pub use simulator::Simulator;
pub use walk::Walk;
