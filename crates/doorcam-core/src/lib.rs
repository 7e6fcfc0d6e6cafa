//! The optics and the mathematics of a doorway camera.
//!
//! The two vertical edges of a doorway cut the light from the room behind it into two fan-shaped shadows on the floor
//! in front. From one patch of that floor at the foot of each edge, this crate computes what changed in the hidden
//! room, who is where, and how accurately anybody could know that. It implements the doorway camera of Krska et al.
//! ("Double Your Corners, Double Your Fun: The Doorway Camera", ICCP 2022); equation and figure numbers are those of
//! the paper.
//!
//! The crate has no camera and no file formats: images come in as samples, and results go out as plain values. The
//! crate `doorcam-source` provides frames, and `doorcam-engine` puts all the steps together.
//!
//! # Modules
//!
//! In the order in which a frame meets them:
//!
//! | Module | What it does |
//! |---|---|
//! | [`image`], [`optics`] | decoded samples; the camera's transfer function and lens |
//! | [`calibration`] | fits the camera to marked points on the floor |
//! | [`light`] | from an image to two patches in linear light; background, noise, drift |
//! | [`alignment`] | whether the camera still looks where it did |
//! | [`geometry`] | doorway, biangular coordinates, the grid of facets (eq. 3, 5) |
//! | [`transport`] | how much light each facet sends to each floor pixel (eq. 2) |
//! | [`solver`] | the inverse problem: which facets changed, and how (eq. 12, 13) |
//! | [`scene`] | the views from both edges and the unified map (eq. 14, 15) |
//! | [`tracking`] | finds people between the facets, follows them, counts them in zones |
//! | [`visible`] | the camera's own side: who walks through the doorway |
//! | [`bound`] | the Cramér-Rao bound: how accurate a place can be at best (eq. 6 to 11) |
//! | [`quadrature`] | numerical integrals, for the bound and for simulators |
//!
//! # Conventions
//!
//! - **Door frame.** The origin is on the floor at the middle of the opening, in the plane of the wall's hidden face.
//!   For someone on the visible side who faces the door, x points to the right, y into the hidden room and z up.
//! - **Units.** Lengths are in metres and angles in radians, unless a name says otherwise (`_px`, `_deg`).
//! - **Pairs** are left then right, as in [`geometry::Side::BOTH`]. Patches are stored row by row, starting at the
//!   wall.
//! - **Light** is linear, and 1 is the camera's full scale. A facet's light is a change of its radiance against the
//!   empty room, negative where the room became darker. The factor albedo / π of the floor is left out.
//!
//! # Features
//!
//! - `schema` (off by default): OpenAPI schemas of the public types, with utoipa.
//!
//! # Example
//!
//! One facet of the room becomes darker, as it does when somebody stands there. The solver sees only what that changes
//! on the floor, and finds the facet:
//!
//! ```
//! use doorcam_core::geometry::{Doorway, FacetGrid, GridSpec, Side};
//! use doorcam_core::light::PatchPair;
//! use doorcam_core::solver::{Admissible, Columns, Limits, Nuisance, Pixels, Projection, Solver};
//! use doorcam_core::transport::{Kernel, PatchGrid, PixelLayout, Transport, TransportSpec, edge_foot_mask};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let doorway = Doorway { width_m: 0.8, wall_thickness_m: 0.1, height_m: None, leaf: None };
//! let grid = FacetGrid::new(&doorway, &GridSpec::published())?;
//! let patch = PatchGrid { size: 32, fov_m: 0.3, layout: PixelLayout::Cells };
//! let spec = TransportSpec { kernel: Kernel::Radiometric, facet_height_m: 2.0, patch };
//! let transport = Transport::new(&doorway, &grid.facets, &spec);
//!
//! // What the two patches measure when the radiance of one facet changes, in red, green and blue.
//! let changed = 100;
//! let mut difference = PatchPair::zeros(patch.size);
//! for side in Side::BOTH {
//!     for (channel, radiance) in [-0.3, -0.2, -0.1].into_iter().enumerate() {
//!         let light = transport.side(side).column(changed) * radiance;
//!         let pixels = difference.side_mut(side).plane_mut(channel).iter_mut();
//!         pixels.zip(&light).for_each(|(pixel, &light)| *pixel = light as f32);
//!     }
//! }
//!
//! // Back from the floor to the room: eq. 13, with even light on either patch as the only nuisance.
//! let pixels = Pixels::uniform(&[edge_foot_mask(&patch), edge_foot_mask(&patch)]);
//! let nuisance = Nuisance::constant(patch.pixels());
//! let projection = Projection::new(&transport, &pixels, &nuisance, Columns::UnitNorm);
//! let mut frame = projection.correlations();
//! projection.project(&difference, &mut frame)?;
//! let solver = Solver::new(projection.gram(), vec![Admissible::Signed; grid.len()]);
//! let lambda = 0.1 * solver.lambda_max(&frame);
//! let solution = solver.solve(&frame, lambda, Limits::default(), None);
//!
//! let lit: Vec<usize> = (0..grid.len()).filter(|&n| solution.intensities[n].strength() > 0.0).collect();
//! assert_eq!(lit, [changed]);
//! # Ok(())
//! # }
//! ```

// What a user, a file or a device gives must never panic.
#![warn(clippy::unwrap_used, clippy::expect_used)]

pub mod alignment;
pub mod bound;
pub mod calibration;
pub mod geometry;
pub mod image;
pub mod light;
pub mod optics;
pub mod quadrature;
pub mod scene;
#[cfg(feature = "schema")]
pub mod schema;
pub mod solver;
pub mod still_room;
#[cfg(test)]
mod testing;
pub mod tracking;
pub mod transport;
pub mod visible;
