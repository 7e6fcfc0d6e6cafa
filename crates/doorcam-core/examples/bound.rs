//! How accurately anybody could locate a person behind a doorway: `cargo run -p doorcam-core --example bound`
//!
//! Prints the Cramér-Rao bound for one frame at a few places. An argument changes the noise of a pixel, as a share of
//! the floor's level: `cargo run -p doorcam-core --example bound -- 0.002`

use doorcam_core::bound::{Bound, PersonSetup, Setup, Strategy};

/// Places behind the door: metres to the right of its middle, and metres into the room.
const PLACES: [[f64; 2]; 6] = [[0.0, 1.0], [0.0, 2.0], [0.0, 3.0], [0.0, 4.0], [1.0, 1.0], [1.0, 3.0]];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut setup = PersonSetup::USUAL;
    if let Some(noise) = std::env::args().nth(1) {
        setup.measured = Setup { noise: noise.parse()?, ..setup.measured };
    }
    setup.validate()?;

    let Setup { doorway, patch_m, pixels, noise } = setup.measured;
    println!("A door of {} m in a wall of {} m.", doorway.width_m, doorway.wall_thickness_m);
    println!("Two patches of {patch_m} m with {pixels} x {pixels} pixels, each with a noise of {} %.", 100.0 * noise);
    println!("A person {} m tall, {} % as bright as the room.\n", setup.height_m, 100.0 * (1.0 + setup.contrast));

    println!("   x      y      error   along x   along y   with one edge");
    println!("   m      m         cm        cm        cm              cm");
    for [x, y] in PLACES {
        let both = setup.bound(Strategy::Doorway, [x, y]);
        let one = setup.bound(Strategy::SingleCorner, [x, y]);
        let [along_x, along_y] = deviations(&both);
        let [error, single] = [both, one].map(|bound| 100.0 * bound.error_m());
        println!("{x:4.1}   {y:4.1}   {error:8.1}  {along_x:8.1}  {along_y:8.1}        {single:8.1}");
    }
    Ok(())
}

/// The standard deviations along x and y, in centimetres.
fn deviations(bound: &Bound) -> [f64; 2] {
    [0, 1].map(|axis| 100.0 * bound.covariance_m2[axis][axis].sqrt())
}
