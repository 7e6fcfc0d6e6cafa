use super::super::room::{Surface as Grid, Taps, Vector, WallHit};
use super::super::scenario::{RoomSpec, Scenario, WallName};
use super::solid::Solid;
use doorcam_core::geometry::Point;
use doorcam_core::scene::Rgb;

/// Side of the texels that the floor before the doorway sees, and of the patches between which light is exchanged, in
/// metres.
const TEXEL_M: f64 = 0.15;
const PATCH_M: f64 = 0.32;
/// Samples along each side of a texel, over which its albedo is averaged.
const SAMPLES: usize = 4;
/// Albedo of glass and of screens, where their own light is not meant.
const GLASS: Rgb = [0.06; 3];

/// The room's own surfaces by their number; furniture's follow.
pub(super) const BACK: usize = 1;
pub(super) const CEILING: usize = 3;
const FLOOR: usize = 4;
pub(super) const FRONT: usize = 5;

/// A rectangle that reflects light. A place on it has the coordinates (u, v) in metres from its origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface {
    pub(super) origin: Vector,
    along: Vector,
    up: Vector,
    normal: Vector,
    albedo: Rgb,
    /// The texels that are seen; none if no floor point sees it.
    seen: Option<Grid>,
    size: [f64; 2],
}

/// A small piece of a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texel {
    pub(super) centre: Vector,
    /// Pointing away from the surface.
    pub(super) normal: Vector,
    pub(super) albedo: Rgb,
    pub(super) area: f64,
    pub(super) surface: usize,
}

/// All surfaces of the room and of what stands in it.
#[derive(Debug, Clone)]
pub(super) struct Shell {
    room: RoomSpec,
    pub(super) surfaces: Vec<Surface>,
    pub(super) solids: Vec<Solid>,
    /// The first surface of each solid: four sides, top and underside.
    pub(super) of_solid: Vec<usize>,
    /// The texels of all surfaces that are seen.
    pub(super) texels: Vec<Texel>,
    /// All surfaces in larger pieces.
    pub(super) patches: Vec<Texel>,
}

/// Sides, top and underside of a solid.
const SIDES: usize = 4;
const UNDERSIDE: usize = 5;

impl Shell {
    pub(super) fn new(scenario: &Scenario) -> Self {
        let room = scenario.room;
        let RoomSpec { half_width_m: w, depth_m: d, ceiling_m: h, albedo, .. } = room;
        let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let plain =
            |origin, along, up, normal, size, albedo| Surface { origin, along, up, normal, albedo, seen: None, size };
        let opposite = |v: Vector| v.map(|c| -c);
        let mut surfaces = vec![
            plain([-w, 0.0, 0.0], y, z, x, [d, h], albedo.left),
            plain([-w, d, 0.0], x, z, opposite(y), [2.0 * w, h], albedo.back),
            plain([w, 0.0, 0.0], y, z, opposite(x), [d, h], albedo.right),
            plain([-w, 0.0, h], x, y, opposite(z), [2.0 * w, d], albedo.ceiling),
            plain([-w, 0.0, 0.0], x, y, z, [2.0 * w, d], albedo.floor),
            plain([-w, 0.0, 0.0], x, z, y, [2.0 * w, h], albedo.front),
        ];
        let solids = Solid::all(scenario);
        let mut of_solid = Vec::new();
        for solid in &solids {
            of_solid.push(surfaces.len());
            let tall = solid.top - solid.bottom;
            for k in 0..SIDES {
                let (a, along, length) = solid.side(k);
                let [ax, ay] = along;
                let (along, out) = ([ax, ay, 0.0], [ay, -ax, 0.0]);
                surfaces.push(plain([a[0], a[1], solid.bottom], along, z, out, [length, tall], solid.albedo));
            }
            let ((a, [ux, uy], length), (_, _, wide)) = (solid.side(0), solid.side(1));
            for (height, normal) in [(solid.top, z), (solid.bottom, opposite(z))] {
                let origin = [a[0], a[1], height];
                surfaces.push(plain(origin, [ux, uy, 0.0], [-uy, ux, 0.0], normal, [length, wide], solid.albedo));
            }
        }
        let mut shell = Self { room, surfaces, solids, of_solid, texels: Vec::new(), patches: Vec::new() };
        for index in 0..shell.surfaces.len() {
            if shell.is_seen(index) {
                let (grid, texels) = shell.cut(index, TEXEL_M, shell.texels.len(), scenario);
                shell.texels.extend(texels);
                shell.surfaces[index].seen = Some(grid);
            }
            if shell.is_open(index) {
                let (_, patches) = shell.cut(index, PATCH_M, 0, scenario);
                shell.patches.extend(patches);
            }
        }
        shell
    }

    /// Which face of a solid a surface is; none for the room's own.
    fn face(&self, surface: usize) -> Option<(usize, &Solid)> {
        let beyond = surface.checked_sub(FRONT + 1)?;
        Some((beyond % (SIDES + 2), &self.solids[beyond / (SIDES + 2)]))
    }

    /// Whether light falls on a surface: not on undersides that stand on the floor.
    fn is_open(&self, surface: usize) -> bool {
        self.face(surface).is_none_or(|(face, solid)| face != UNDERSIDE || solid.bottom > 0.0)
    }

    /// Whether a point of the floor may see a surface: only what is upright or shows its underside.
    fn is_seen(&self, surface: usize) -> bool {
        match self.face(surface) {
            None => surface != FLOOR && surface != FRONT,
            Some((face, _)) => face != SIDES && self.is_open(surface),
        }
    }

    fn cut(&self, index: usize, side: f64, start: usize, scenario: &Scenario) -> (Grid, Vec<Texel>) {
        let surface = self.surfaces[index];
        let count = surface.size.map(|length| (length / side).round().max(1.0) as usize);
        let grid = Grid { start, count, size: surface.size };
        let step = [0, 1].map(|k| surface.size[k] / count[k] as f64);
        let mut texels = Vec::with_capacity(count[0] * count[1]);
        for k in 0..count[0] * count[1] {
            let (column, row) = (k % count[0], k / count[0]);
            let at = |du: f64, dv: f64| [(column as f64 + du) * step[0], (row as f64 + dv) * step[1]];
            let fraction = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
            let mut albedo = [0.0; 3];
            for j in 0..SAMPLES * SAMPLES {
                let colour = self.painted(index, at(fraction(j / SAMPLES), fraction(j % SAMPLES)), scenario);
                (0..3).for_each(|c| albedo[c] += colour[c] / (SAMPLES * SAMPLES) as f64);
            }
            let centre = surface.place(at(0.5, 0.5));
            texels.push(Texel { centre, normal: surface.normal, albedo, area: step[0] * step[1], surface: index });
        }
        (grid, texels)
    }

    /// The albedo at a place: windows and screens are on top of panels, which are on top of walls.
    fn painted(&self, surface: usize, [u, v]: Point, scenario: &Scenario) -> Rgb {
        let plain = self.surfaces[surface].albedo;
        let (wall, along) = match surface {
            0 => (WallName::Left, u),
            BACK => (WallName::Back, u - self.room.half_width_m),
            2 => (WallName::Right, u),
            FRONT => {
                let door = &scenario.doorway;
                let open = (u - self.room.half_width_m).abs() < door.half_width()
                    && door.height_m.is_none_or(|height| v < height);
                return if open { [0.0; 3] } else { plain };
            }
            _ => return plain,
        };
        let covers = |on: WallName, along_m: [f64; 2], up_m: [f64; 2]| {
            let within = |[from, to]: [f64; 2], at: f64| (from..to).contains(&at);
            on == wall && within(along_m, along) && within(up_m, v)
        };
        let glass = scenario.window.iter().any(|w| covers(w.wall, w.along_m, w.up_m))
            || scenario.television.iter().any(|t| covers(t.wall, t.along_m, t.up_m));
        if glass {
            return GLASS;
        }
        let panel = scenario.panel.iter().rev().find(|p| covers(p.wall, p.along_m, p.up_m));
        panel.map_or(plain, |panel| panel.albedo)
    }

    /// Where a horizontal ray from a floor point meets a wall.
    pub(super) fn wall(&self, [x, y]: Point, ray: Point) -> WallHit {
        let (w, d) = (self.room.half_width_m, self.room.depth_m);
        let back = (d - y) / ray[1];
        let (side, beside) = if ray[0] < 0.0 { (0, (-w - x) / ray[0]) } else { (2, (w - x) / ray[0]) };
        if ray[1] > 0.0 && back <= beside {
            WallHit { surface: BACK, u: x + back * ray[0] + w, distance: back }
        } else {
            WallHit { surface: side, u: y + beside * ray[1], distance: beside }
        }
    }

    /// The texels at the end of a ray that meets nothing before wall or ceiling.
    pub(super) fn taps(&self, from: Point, ray: Point, wall: &WallHit, s: f64) -> Option<Taps> {
        let slope = slope(s);
        let z = wall.distance * slope;
        if z <= self.room.ceiling_m {
            return self.surfaces[wall.surface].taps([wall.u, z]);
        }
        self.level(CEILING, from, ray, s)
    }

    /// The texels of a level surface, seen from below.
    pub(super) fn level(&self, surface: usize, from: Point, ray: Point, s: f64) -> Option<Taps> {
        let surface = &self.surfaces[surface];
        let distance = surface.origin[2] / slope(s);
        let d = [0, 1].map(|k| from[k] + distance * ray[k] - surface.origin[k]);
        surface.taps([d[0] * surface.along[0] + d[1] * surface.along[1], d[0] * surface.up[0] + d[1] * surface.up[1]])
    }

    /// Azimuths at which something begins or ends, seen from a floor point: corners of the room and of solids.
    pub(super) fn corners(&self) -> impl Iterator<Item = Point> + '_ {
        let (w, d) = (self.room.half_width_m, self.room.depth_m);
        [[-w, d], [w, d]].into_iter().chain(self.solids.iter().flat_map(|solid| solid.corners))
    }

    pub(super) fn ceiling(&self) -> f64 {
        self.room.ceiling_m
    }

    pub(super) fn half_width(&self) -> f64 {
        self.room.half_width_m
    }

    pub(super) fn depth(&self) -> f64 {
        self.room.depth_m
    }
}

impl Surface {
    fn place(&self, [u, v]: Point) -> Vector {
        [0, 1, 2].map(|k| self.origin[k] + u * self.along[k] + v * self.up[k])
    }

    pub(super) fn taps(&self, at: Point) -> Option<Taps> {
        self.seen.map(|grid| grid.taps(at))
    }
}

impl Texel {
    /// Half of its side, in metres.
    pub(super) fn half(&self) -> f64 {
        self.area.sqrt() / 2.0
    }
}

/// Tangent of an elevation whose sin² is s.
pub(super) fn slope(s: f64) -> f64 {
    (s / (1.0 - s).max(1e-12)).sqrt()
}
