use super::point::place_of;
use crate::geometry::{Biangular, Doorway};

/// Points for figure 5: crossings of the lines of equal angle, 15° apart from 30° to 120° at each edge, up to 2.2 door
/// widths behind the door. The paper does not list the points it plots.
pub fn plotted_angles(doorway: &Doorway) -> Vec<Biangular> {
    let lines = || (2..9).map(|k| f64::from(15 * k).to_radians());
    let crossings = lines().flat_map(|alpha1| lines().map(move |alpha2| Biangular { alpha1, alpha2 }));
    let shown = |angles: &Biangular| place_of(doorway, *angles).is_some_and(|[_, y]| y < 2.2 * doorway.width_m);
    crossings.filter(shown).collect()
}
