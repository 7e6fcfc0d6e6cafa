//! A doorway whose truth is known, rendered without the reconstruction's own matrix (docs/simulator.md).
//!
//! The reconstruction knows only flat facets on a grid. Here the hidden room is continuous: lamps light walls with
//! panels, the ceiling, and people anywhere, who throw shadows and hide walls, lamps and each other. What is seen of it
//! through the opening lights the floor, which a noisy camera looks at. A [`Scenario`] says what there is and how it
//! moves. A [`Simulator`] makes any of its frames, [`record_simulation`] a recording with truth, and [`LiveSimulation`]
//! a live source.
//!
//! [`luminous`] is a simpler world for tests.

mod camera_spec;
mod check;
mod crossings;
mod exposure;
mod figure;
mod floor;
mod lamp;
mod light;
mod live;
pub mod luminous;
mod ordinary;
mod recording;
mod room;
mod scenario;
mod simulator;
mod variation;
mod view;
mod visible;
mod walk;

pub use live::{LiveOptions, LiveSimulation};
pub use ordinary::{FurnitureSpec, LampFacing, LeafSpec, SunSpec, TelevisionSpec, WindowSpec};
pub use recording::{SimulationError, record_simulation};
pub use scenario::{
    CameraSpec, FlickerSpec, FloorSpec, FrameFormat, LampKind, LampSpec, PanelSpec, PersonSpec, RoomAlbedo, RoomSpec,
    Scenario, ScenarioError, VisibleSpec, WallName,
};
pub use simulator::Simulator;
pub use visible::{ObjectSpec, VisibleLampSpec, WallSpec};
pub use walk::Walk;
