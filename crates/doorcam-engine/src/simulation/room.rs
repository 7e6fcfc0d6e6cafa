use super::scenario::{PanelSpec, RoomSpec, WallName};
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;

/// Side of the texels of walls and ceiling, in metres: about two degrees as seen from the door.
const TEXEL_M: f64 = 0.1;
/// Samples along each side of a texel, over which its albedo is averaged.
const ALBEDO_SAMPLES: usize = 4;

/// A point or direction in space: (x, y, z) in the door frame, in metres.
pub(super) type Vector = [f64; 3];

/// The parts of the hidden room that are seen through the doorway: left, back and right wall and the ceiling, cut into
/// texels.
///
/// A place on a surface has coordinates (u, v) in metres: (y, z) on the side walls, (x + half width, z) on the back
/// wall and (x + half width, y) on the ceiling.
#[derive(Debug, Clone)]
pub(super) struct Shell {
    pub(super) half_width: f64,
    pub(super) depth: f64,
    pub(super) height: f64,
    surfaces: [Surface; 4],
    /// The texels of all surfaces, one surface after the other.
    pub(super) texels: Vec<Texel>,
}

/// The texels of a rectangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    /// Index of its first texel.
    pub(super) start: usize,
    /// Texels along u and v.
    pub(super) count: [usize; 2],
    /// Its size along u and v, in metres.
    pub(super) size: [f64; 2],
}

/// A small piece of wall or ceiling.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texel {
    pub(super) centre: Vector,
    /// Pointing into the room.
    pub(super) normal: Vector,
    pub(super) albedo: Rgb,
    /// Half of its side, in metres.
    pub(super) half: f64,
}

/// Four neighbouring texels and their weights.
pub(super) type Taps = [(usize, f64); 4];

const CEILING: usize = 3;

impl Shell {
    pub(super) fn new(room: &RoomSpec, panels: &[PanelSpec]) -> Self {
        let RoomSpec { half_width_m: half_width, depth_m: depth, ceiling_m: height, albedo, .. } = *room;
        let sizes = [[depth, height], [2.0 * half_width, height], [depth, height], [2.0 * half_width, depth]];
        let mut start = 0;
        let surfaces = sizes.map(|size| {
            let count = size.map(|side| (side / TEXEL_M).round().max(1.0) as usize);
            let surface = Surface { start, count, size };
            start += count[0] * count[1];
            surface
        });
        let plain = [albedo.left, albedo.back, albedo.right, albedo.ceiling];
        let mut shell = Self { half_width, depth, height, surfaces, texels: Vec::with_capacity(start) };
        for (index, surface) in surfaces.iter().enumerate() {
            for row in 0..surface.count[1] {
                for column in 0..surface.count[0] {
                    let side = [0, 1].map(|k| surface.size[k] / surface.count[k] as f64);
                    let at = |du: f64, dv: f64| [(column as f64 + du) * side[0], (row as f64 + dv) * side[1]];
                    let n = ALBEDO_SAMPLES;
                    let fraction = |k: usize| (k as f64 + 0.5) / n as f64;
                    let mut albedo = [0.0; 3];
                    for k in 0..n * n {
                        let colour = shell.painted(index, at(fraction(k / n), fraction(k % n)), plain[index], panels);
                        (0..3).for_each(|c| albedo[c] += colour[c] / (n * n) as f64);
                    }
                    let (centre, normal) = shell.place(index, at(0.5, 0.5));
                    shell.texels.push(Texel { centre, normal, albedo, half: (side[0] * side[1]).sqrt() / 2.0 });
                }
            }
        }
        shell
    }

    /// The albedo at a place: that of the last panel that covers it, otherwise `plain`.
    fn painted(&self, surface: usize, [u, v]: Point, plain: Rgb, panels: &[PanelSpec]) -> Rgb {
        let (surfaces, u) = match surface {
            0 => (Some(WallName::Left), u),
            1 => (Some(WallName::Back), u - self.half_width),
            2 => (Some(WallName::Right), u),
            _ => (None, u),
        };
        let covers = |[from, to]: [f64; 2], at: f64| (from..to).contains(&at);
        let here =
            |panel: &&PanelSpec| Some(panel.wall) == surfaces && covers(panel.along_m, u) && covers(panel.up_m, v);
        panels.iter().rev().find(here).map_or(plain, |panel| panel.albedo)
    }

    fn place(&self, surface: usize, [u, v]: Point) -> (Vector, Vector) {
        match surface {
            0 => ([-self.half_width, u, v], [1.0, 0.0, 0.0]),
            1 => ([u - self.half_width, self.depth, v], [0.0, -1.0, 0.0]),
            2 => ([self.half_width, u, v], [-1.0, 0.0, 0.0]),
            _ => ([u - self.half_width, v, self.height], [0.0, 0.0, -1.0]),
        }
    }

    /// Where a horizontal ray from a floor point meets a wall.
    pub(super) fn wall(&self, [x, y]: Point, ray: Point) -> WallHit {
        let back = (self.depth - y) / ray[1];
        let (side, beside) =
            if ray[0] < 0.0 { (0, (-self.half_width - x) / ray[0]) } else { (2, (self.half_width - x) / ray[0]) };
        if ray[1] > 0.0 && back <= beside {
            WallHit { surface: 1, u: x + back * ray[0] + self.half_width, distance: back }
        } else {
            WallHit { surface: side, u: y + beside * ray[1], distance: beside }
        }
    }

    /// Where a ray with azimuth `ray` and sin² of elevation `s` from a floor point ends.
    pub(super) fn taps(&self, [x, y]: Point, ray: Point, wall: &WallHit, s: f64) -> Taps {
        let slope = (s / (1.0 - s).max(1e-12)).sqrt();
        let z = wall.distance * slope;
        if z <= self.height {
            return self.surfaces[wall.surface].taps([wall.u, z]);
        }
        let distance = self.height / slope;
        self.surfaces[CEILING].taps([x + distance * ray[0] + self.half_width, y + distance * ray[1]])
    }
}

/// Where a horizontal ray meets a wall.
#[derive(Debug, Clone, Copy)]
pub(super) struct WallHit {
    pub(super) surface: usize,
    pub(super) u: f64,
    pub(super) distance: f64,
}

impl Surface {
    /// Bilinear between the texels' centres, constant beyond the outermost ones.
    pub(super) fn taps(&self, at: Point) -> Taps {
        let [(i, a), (j, b)] = [0, 1].map(|k| {
            let last = self.count[k] - 1;
            let place = (at[k] / self.size[k] * self.count[k] as f64 - 0.5).clamp(0.0, last as f64);
            let low = (place as usize).min(last.saturating_sub(1));
            (low, place - low as f64)
        });
        let [right, up] = [0, 1].map(|k| usize::from(self.count[k] > 1));
        let base = self.start + j * self.count[0] + i;
        let above = base + up * self.count[0];
        [(base, (1.0 - a) * (1.0 - b)), (base + right, a * (1.0 - b)), (above, (1.0 - a) * b), (above + right, a * b)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenario::Scenario;
    use super::*;

    fn shell() -> Shell {
        let scenario = Scenario::parse(super::super::scenario::SMALLEST).unwrap();
        Shell::new(&scenario.room, &scenario.panel)
    }

    /// Interpolated texel positions agree with the end of each ray, found by marching along it.
    #[test]
    fn rays_end_where_marching_them_leaves_the_room() {
        let shell = shell();
        for (pixel, phi, s) in
            [([-0.4, -0.2], 0.5_f64, 0.1), ([0.4, -0.1], -1.1, 0.2), ([0.1, -0.3], 0.1, 0.85), ([0.3, -0.1], 0.9, 0.5)]
        {
            let ray = [phi.sin(), phi.cos()];
            let slope = f64::sqrt(s / (1.0 - s));
            let at = |r: f64| [pixel[0] + r * ray[0], pixel[1] + r * ray[1], r * slope];
            let inside = |[x, y, z]: Vector| x.abs() < shell.half_width && y < shell.depth && z < shell.height;
            let mut r = 0.0;
            while inside(at(r)) {
                r += 1e-4;
            }
            let taps = shell.taps(pixel, ray, &shell.wall(pixel, ray), s);
            let mean = |axis: usize| taps.iter().map(|&(k, w)| w * shell.texels[k].centre[axis]).sum::<f64>();
            let found = [mean(0), mean(1), mean(2)];
            for (found, met) in found.into_iter().zip(at(r)) {
                assert!((found - met).abs() < 2e-3, "{found:?} {met:?}");
            }
            assert!((taps.iter().map(|t| t.1).sum::<f64>() - 1.0).abs() < 1e-12);
        }
    }
}
