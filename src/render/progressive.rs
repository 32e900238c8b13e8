//! The passes of progressive photon mapping.

use std::ops::Range;

use super::{Control, Session, render_pass};
use crate::film::Film;
use crate::gather::{NARROW, RadiusMap};
use crate::integrator::sppm::{
    FoundPhotons, KINDS, PILOT_PASS, PassMaps, Radii, SharedStatistics, Sppm, SppmSettings, radius_sq_ratio,
};
use crate::photon::{Kernel, PhotonMap};
use crate::scene::Item;
use crate::shoot::{Emission, Target};
use crate::tally::Counters;

/// What progressive photon mapping keeps from pass to pass.
pub(super) struct Progressive {
    /// First radii; follow from scene and plan alone.
    pub radii: Radii,
    /// How every pass emits the photons of each kind of map; follow from scene and plan alone.
    emitted: PassEmission,
    /// Follow from all passes before; only where the plan says so.
    pub shared: Option<SharedStatistics>,
}

/// By the position of the target among those of the settings.
type PassEmission = [Emission; KINDS];

impl Session<'_> {
    /// Shoots and balances the photons of one pass, then takes its camera samples. Where bias is tracked, returns what the
    /// same samples see with [narrow](NARROW) radii.
    pub(super) fn progressive_pass(
        &mut self,
        settings: &SppmSettings,
        film: &mut Film,
        samples: Range<u64>,
        control: &Control,
        report: &(dyn Fn(f64) + Sync),
    ) -> (Counters, Option<Film>) {
        self.prepare_progressive(settings, control);
        let emitted = self.progressive.as_ref().map_or_else(PassEmission::default, |p| p.emitted.clone());
        let maps = self.pass_maps(settings, self.next, &emitted, control);
        control.progress.phase("render");
        let (scene, seed) = (self.scene, self.plan.seed);
        let kept = self.progressive.as_mut().expect("prepared above");
        let found = kept.shared.is_some().then(|| FoundPhotons::new(kept.radii.len()));
        let recipe = Sppm {
            settings: *settings,
            maps: &maps,
            radii: &kept.radii,
            shrink: radius_sq_ratio(self.next, settings.alpha) as f32,
            read: 1.0,
            shared: kept.shared.as_ref().zip(found.as_ref()),
            visible_lights: scene.lights.iter().any(|l| !l.is_delta()),
        };
        let range = samples.clone();
        let mut counters = self.summary.time("render", || render_pass(scene, &recipe, film, seed, range, report));
        let narrow = self.plan.tells_bias(self.next).then(|| {
            // Photons found in narrow discs do not count for the radii.
            let uncounted = kept.shared.is_some().then(|| FoundPhotons::new(kept.radii.len()));
            let recipe = Sppm { read: NARROW, shared: kept.shared.as_ref().zip(uncounted.as_ref()), ..recipe };
            let mut narrow = film.fresh();
            let again = || render_pass(scene, &recipe, &mut narrow, seed, samples, &|_| {});
            counters += self.summary.time("estimate bias", again);
            narrow
        });
        if let (Some(shared), Some(found)) = (&mut kept.shared, &found) {
            shared.update(found, settings.alpha);
        }
        (counters, narrow)
    }

    /// Measures the first radii, unless that is done.
    pub(super) fn prepare_progressive(&mut self, settings: &SppmSettings, control: &Control) {
        if self.progressive.is_some() {
            return;
        }
        control.progress.phase("shoot photons");
        let mut emitted = PassEmission::default();
        for (emission, target) in emitted.iter_mut().zip(settings.targets()) {
            let shooting = settings.shoot_settings(self.plan.seed, PILOT_PASS, target, self.scene.sampler.sequence);
            *emission = self.summary.time("shoot photons", || crate::shoot::plan_emission(self.scene, &shooting));
        }
        let pilot = match settings.initial_radius {
            Some(_) => PassMaps::default(),
            None => self.pass_maps(settings, PILOT_PASS, &emitted, control),
        };
        control.progress.phase("measure radii");
        let (scene, seed) = (self.scene, self.plan.seed);
        let radii = self.summary.time("measure radii", || Radii::measure(scene, settings, &pilot, seed));
        let resumed = self.resumed_shared.take();
        let shared = settings.shared_statistics.then(|| resumed.unwrap_or_else(|| SharedStatistics::new(&radii)));
        self.progressive = Some(Progressive { radii, emitted, shared });
    }

    fn pass_maps(&mut self, settings: &SppmSettings, pass: u64, emitted: &PassEmission, control: &Control) -> PassMaps {
        let (scene, summary) = (self.scene, &mut self.summary);
        let mut maps = PassMaps::default();
        let directions = self.plan.needs.wants(Item::Directions);
        for (target, emission) in settings.targets().zip(emitted) {
            control.progress.phase("shoot photons");
            let shooting = settings.shoot_settings(self.plan.seed, pass, target, scene.sampler.sequence);
            let shot = summary.time("shoot photons", || crate::shoot::shoot_paths(scene, &shooting, emission));
            if pass != PILOT_PASS {
                summary.add_shot(target, &shot);
            }
            control.progress.phase("balance map");
            let map = summary.time("balance map", || PhotonMap::build_with(shot.photons, directions));
            let map = RadiusMap::new(map, Kernel::Epanechnikov);
            match target {
                Target::Caustic => maps.caustic = map,
                Target::Global | Target::Indirect => maps.indirect = map,
            }
        }
        summary.photon_memory = summary.photon_memory.max(maps.memory());
        maps
    }
}
