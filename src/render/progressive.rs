//! The passes of progressive photon mapping.

use std::ops::Range;

use super::pass::{render_films, sightings};
use super::{ChainSummary, Control, Session, render_pass};
use crate::film::Film;
use crate::gather::RadiusMap;
use crate::integrator::sppm::{
    KINDS, PILOT_PASS, PassMaps, PhotonSampling, Radii, SharedStatistics, Sighting, Sightings, Sppm, SppmSettings,
    radius_sq_ratio,
};
use crate::photon::{Kernel, PhotonMap};
use crate::scene::Item;
use crate::shoot::{Chains, Emission, Shot, Target};
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
type PassEmission = [TargetEmission; KINDS];

/// How one kind of photons is emitted.
#[derive(Clone, Default)]
struct TargetEmission {
    emission: Emission,
    /// Where photon paths are sampled by what is seen of them.
    chains: Chains,
}

impl Session<'_> {
    /// Shoots and balances the photons of one pass, then takes its camera samples. Where bias is tracked, returns what the
    /// same samples see with [narrow](crate::gather::NARROW) radii.
    pub(super) fn progressive_pass(
        &mut self,
        settings: &SppmSettings,
        film: &mut Film,
        samples: Range<u64>,
        control: &Control,
        report: &(dyn Fn(f64) + Sync),
    ) -> (Counters, Option<Film>) {
        self.prepare_progressive(settings, control);
        let (scene, seed) = (self.scene, self.plan.seed);
        let mut kept = self.progressive.take().expect("prepared above");
        let found = kept.shared.as_ref().map(SharedStatistics::begin);
        let nothing = PassMaps::default();
        let mut recipe = Sppm {
            settings: *settings,
            maps: &nothing,
            radii: &kept.radii,
            shrink: radius_sq_ratio(self.next, settings.alpha) as f32,
            shared: kept.shared.as_ref().zip(found.as_ref()),
            visible_lights: scene.lights.iter().any(|l| !l.is_delta()),
        };
        let seen = self.look_ahead(settings, &recipe, samples.clone(), control);
        let maps = self.pass_maps(settings, self.next, &kept.emitted, seen.as_deref(), control);
        recipe.maps = &maps;
        control.progress.phase("render");
        let mut narrow = self.plan.tells_bias(self.next).then(|| film.fresh());
        let counters = self.summary.time("render", || match &mut narrow {
            Some(narrow) => render_films(scene, &recipe, [film, narrow], seed, samples, report),
            None => render_pass(scene, &recipe, film, seed, samples, report),
        });
        if let (Some(shared), Some(found)) = (&mut kept.shared, &found) {
            shared.update(found, settings.alpha);
        }
        self.progressive = Some(kept);
        (counters, narrow)
    }

    /// Where a pass will read photons, if that is to decide where they are shot.
    fn look_ahead(
        &mut self,
        settings: &SppmSettings,
        recipe: &Sppm,
        samples: Range<u64>,
        control: &Control,
    ) -> Option<Vec<Sighting>> {
        if settings.photon_sampling != PhotonSampling::Visibility {
            return None;
        }
        control.progress.phase("look ahead");
        let (scene, seed, mut counters) = (self.scene, self.plan.seed, Counters::default());
        let seen = self.summary.time("look ahead", || sightings(scene, recipe, seed, samples, &mut counters));
        self.summary.counters += counters;
        Some(seen)
    }

    /// Measures the first radii, unless that is done.
    pub(super) fn prepare_progressive(&mut self, settings: &SppmSettings, control: &Control) {
        if self.progressive.is_some() {
            return;
        }
        control.progress.phase("shoot photons");
        let mut emitted = PassEmission::default();
        for (how, target) in emitted.iter_mut().zip(settings.targets()) {
            let shooting = settings.shoot_settings(self.plan.seed, PILOT_PASS, target, self.scene.sampler.sequence);
            how.emission = self.summary.time("shoot photons", || crate::shoot::plan_emission(self.scene, &shooting));
        }
        let seen = self.tune_chains(settings, &mut emitted, control);
        let pilot = match settings.initial_radius {
            Some(_) => PassMaps::default(),
            None => self.pass_maps(settings, PILOT_PASS, &emitted, seen.as_deref(), control),
        };
        control.progress.phase("measure radii");
        let (scene, seed) = (self.scene, self.plan.seed);
        let radii = self.summary.time("measure radii", || Radii::measure(scene, settings, &pilot, seed));
        let resumed = self.resumed_shared.take();
        let shared = settings.shares().then(|| resumed.unwrap_or_else(|| SharedStatistics::new(&radii, settings)));
        self.progressive = Some(Progressive { radii, emitted, shared });
    }

    /// Tunes the chains by what the first pass sees with the largest radii, if there are to be chains. Returns what it sees.
    fn tune_chains(
        &mut self,
        settings: &SppmSettings,
        emitted: &mut PassEmission,
        control: &Control,
    ) -> Option<Vec<Sighting>> {
        if settings.photon_sampling != PhotonSampling::Visibility {
            return None;
        }
        let (scene, seed, nothing) = (self.scene, self.plan.seed, PassMaps::default());
        // Whichever passes this machine makes, the chains are those of the first one.
        let rough = SppmSettings {
            boundary_correction: false,
            shared_statistics: false,
            chi_squared_radius: false,
            ..*settings
        };
        let radii = Radii::measure(scene, &rough, &nothing, seed);
        let recipe =
            Sppm { settings: rough, maps: &nothing, radii: &radii, shrink: 1.0, shared: None, visible_lights: true };
        let seen = self.look_ahead(settings, &recipe, self.plan.samples_of(0), control)?;
        control.progress.phase("tune chains");
        for (how, target) in emitted.iter_mut().zip(settings.targets()) {
            let shooting = settings.shoot_settings(seed, PILOT_PASS, target, scene.sampler.sequence);
            let counters = self.summary.time("tune chains", || {
                let points = Sightings::new(&seen, kind_of(target));
                let (chains, counters) =
                    crate::shoot::tune(scene, &shooting, &how.emission, &|photon: &_| points.see(photon));
                how.chains = chains;
                counters
            });
            self.summary.counters += counters;
            self.summary.chains.push(ChainSummary::new(target, &how.chains));
        }
        Some(seen)
    }

    /// The maps of one pass; with `seen`, only of photons that somebody sees.
    fn pass_maps(
        &mut self,
        settings: &SppmSettings,
        pass: u64,
        emitted: &PassEmission,
        seen: Option<&[Sighting]>,
        control: &Control,
    ) -> PassMaps {
        let (scene, summary) = (self.scene, &mut self.summary);
        let mut maps = PassMaps::default();
        let directions = self.plan.needs.wants(Item::Directions);
        for (target, how) in settings.targets().zip(emitted) {
            control.progress.phase("shoot photons");
            let shooting = settings.shoot_settings(self.plan.seed, pass, target, scene.sampler.sequence);
            let shoot = || -> Shot {
                let Some(seen) = seen else { return crate::shoot::shoot_paths(scene, &shooting, &how.emission) };
                let points = Sightings::new(seen, kind_of(target));
                crate::shoot::shoot_visible(scene, &shooting, &how.emission, &how.chains, &|photon: &_| {
                    points.see(photon)
                })
            };
            let shot = summary.time("shoot photons", shoot);
            if pass != PILOT_PASS {
                summary.add_shot(target, &shot);
            }
            control.progress.phase("balance map");
            let map = summary.time("balance map", || PhotonMap::build_with(shot.photons, directions));
            let map = RadiusMap::new(map, Kernel::Epanechnikov);
            match kind_of(target) {
                0 => maps.caustic = map,
                _ => maps.indirect = map,
            }
        }
        summary.photon_memory = summary.photon_memory.max(maps.memory());
        maps
    }
}

/// The number of a kind of photons in [`PassMaps::kind`].
fn kind_of(target: Target) -> usize {
    match target {
        Target::Caustic => 0,
        Target::Global | Target::Indirect => 1,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::time::Instant;

    use super::*;
    use crate::integrator::sppm::Evenness;
    use crate::render::{Plan, PlanOverrides, Silent};
    use crate::scene::{LoadOptions, Scene};

    const SIDE: u32 = 24;

    /// A square of side 2 that a distant light shines on through a pane over `x` < `width` − 1 that changes nothing.
    fn square(width: f32, radius: f32) -> Scene {
        let text = format!(
            r#"<scene version="3.0.0">
  <integrator type="sppm"><boolean name="chi_squared_radius" value="true"/>
    <float name="initial_radius" value="{radius}"/></integrator>
  <sensor type="orthographic">
    <transform name="to_world"><lookat origin="0, 0.5, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="{SIDE}"/><integer name="height" value="{SIDE}"/></film>
    <sampler type="independent"/></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale x="{half}"/><rotate x="1" angle="-90"/>
    <translate x="{middle}" y="0.8"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="1"/><float name="ext_ior" value="1"/></bsdf></shape>
  <emitter type="directional"><vector name="direction" x="0" y="-1" z="0"/></emitter></scene>"#,
            half = 0.5 * width,
            middle = 0.5 * width - 1.0,
        );
        Scene::from_text(&text, std::path::Path::new("scene.xml"), &LoadOptions::default()).expect("a good scene")
    }

    /// Column, squared radius over the first and tests of all pixels but some at the border, after some passes.
    fn radii(scene: &Scene, radius: f32, inner: Range<u32>, o: &PlanOverrides) -> Vec<(u32, f32, Evenness)> {
        let mut session = Session::new(scene, &Plan::new(scene, o).expect("a good plan"));
        let stop = AtomicBool::new(false);
        let control = Control { stop: &stop, time: None, started: Instant::now(), progress: &Silent };
        while !session.finished() {
            session.step(&control);
        }
        let shared = session.progressive.expect("passes").shared.expect("statistics");
        let first = (f64::from(radius) * scene.to_scene.scale).powi(2) as f32;
        let pixels = shared.pixels.iter().zip(&shared.evenness).enumerate();
        pixels
            .map(|(i, (pixel, tests))| (i as u32 % SIDE, i as u32 / SIDE, pixel[0].radius_sq / first, tests[0]))
            .filter(|(x, y, ..)| inner.contains(x) && inner.contains(y))
            .map(|(x, _, radius_sq, tests)| (x, radius_sq, tests))
            .collect()
    }

    fn overrides(passes: u64, photons: u64, seed: u64) -> PlanOverrides {
        PlanOverrides { passes: Some(passes), photons: Some(photons), seed: Some(seed), ..PlanOverrides::default() }
    }

    /// About 12 photons a pass and pixel: the first test comes in the fourth or fifth of six, and a second one hardly ever.
    /// Discs of two pixels do not touch. Of 8 × 484 pixels 1 % fail, within 4 σ of the binomial (0.64 %).
    #[test]
    fn even_light_fails_the_test_as_rarely_as_its_level_says() {
        let s = square(3.0, 0.03);
        let (mut tested, mut failed) = (0, 0);
        for seed in 1..=8 {
            for (_, radius_sq, tests) in radii(&s, 0.03, 1..SIDE - 1, &overrides(6, 17_000, seed)) {
                tested += usize::from(tests.next > 40.0);
                failed += usize::from(radius_sq < 1.0);
            }
        }
        let rate = failed as f64 / tested as f64;
        assert!(tested > 3_700 && (rate - 0.01).abs() < 0.0064, "{failed} of {tested}: {rate}");
    }

    /// At the edge of the light every pixel narrows to less than half of the disc's area. Far from it, and from the end of
    /// the surface, about 5 tests of 1 % have looked at each of 90 pixels; as neighbours see the same photons, four times the
    /// 5 % are allowed.
    #[test]
    fn the_radius_shrinks_at_an_edge_of_light() {
        let pixels = radii(&square(1.0, 0.15), 0.15, 3..SIDE - 3, &overrides(24, 5_000, 1));
        let edge: Vec<_> = pixels.iter().filter(|(x, ..)| matches!(x, 11 | 12)).collect();
        assert!(edge.len() == 36 && edge.iter().all(|(_, r_sq, _)| *r_sq < 0.5), "{edge:?}");
        let far: Vec<_> = pixels.iter().filter(|(x, ..)| *x < 8 || *x > 15).collect();
        let lit = far.iter().filter(|(_, r_sq, t)| *r_sq < 1.0 || t.bins.total() > 0).count();
        let narrowed = far.iter().filter(|(_, r_sq, _)| *r_sq < 1.0).count();
        assert!(lit == 90 && narrowed <= 18, "{narrowed} of {lit}");
    }
}
