//! Converts the configuration to the engine's settings.

use doorcam_core::geometry::GridSpec;
use doorcam_engine::{
    AveragingSettings, BackgroundSettings, PatchSettings, Preprocessing, Settings, SolverSettings, searched,
};

use super::{Config, Preset};

impl Config {
    /// The engine's settings, from the sections on room, floor and people.
    pub fn settings(&self) -> Settings {
        let Self { room, grid, patch, transport, solver, scene, averaging, background, .. } = self;
        let Self { tracker, zones, crossings, camera, doorway, .. } = self;
        let mapped = room.mapped();
        Settings {
            preprocessing: match self.preset {
                Some(Preset::Published) => Preprocessing::Published,
                None => Preprocessing::Linear,
            },
            grid: GridSpec {
                room: mapped,
                intervals: (180.0 / grid.angular_step_deg).round() as usize,
                min_angle: grid.min_angle_deg.to_radians(),
                edge_clearance_m: grid.edge_clearance_m,
                near_sum_m: grid.near_sum_m,
            },
            patch: PatchSettings {
                fov_m: patch.fov_m,
                pixels: patch.pixels,
                exclude: patch.exclude.iter().map(|rectangle| [rectangle.from_m, rectangle.to_m]).collect(),
            },
            kernel: transport.kernel,
            facet_height_m: transport.facet_height_m,
            solver: SolverSettings {
                model: solver.model,
                lambda: solver.lambda,
                lambda_factor: solver.lambda_factor,
                lambda_share: solver.lambda_share,
                max_steps: solver.max_steps,
            },
            unified_threshold: scene.unified_threshold,
            brightness: scene.brightness,
            averaging: AveragingSettings { mode: averaging.mode, time_s: averaging.time_s },
            background: BackgroundSettings {
                learn_s: background.learn_s,
                learn_max_s: background.learn_max_s,
                relearn_s: background.relearn_s,
                adapt_s: background.adapt_s,
                absorb_s: background.absorb_s,
                cover_s: background.cover_s,
                rebuild_s: background.rebuild_s,
                light_step: background.light_step,
                save_s: background.save_s,
                keep_s: background.keep_s,
            },
            tracker: tracker.settings(searched(mapped)),
            dwelling: tracker.dwelling(),
            zones: zones.clone(),
            crossings: crossings.enabled,
            lens: camera.lens(),
            transfer: camera.transfer.clone(),
            follow_px: camera.follow_px,
            leaf: doorway.leaf,
            lights: room.lights.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_and_presets_are_the_engines_own() {
        let of_file = |preset| Config::default().with_preset(preset).settings();
        assert_eq!(of_file(None), Settings::default());
        assert_eq!(of_file(Some(Preset::Published)), Settings::published());
    }
}
