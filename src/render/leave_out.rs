use super::Method;
use crate::integrator::MaxDepth;
use crate::scene::{Item, Needs};

impl Method {
    /// Takes out of the recipe what the scene does not need.
    pub(super) fn leave_out(&mut self, needs: &Needs) {
        let cut = |max_depth: &mut MaxDepth| {
            *max_depth = [*max_depth, needs.longest_path()].into_iter().flatten().min();
        };
        match self {
            Method::Path(p) => cut(&mut p.max_depth),
            Method::Direct(_) => {}
            Method::PhotonMapper(p) => {
                cut(&mut p.max_depth);
                p.caustic_photons *= u64::from(needs.wants(Item::Caustics));
                p.global_photons *= u64::from(needs.wants(Item::Global));
                p.final_gather &= needs.wants(Item::Gather);
            }
            Method::Ppm(p) | Method::Sppm(p) => cut(&mut p.max_depth),
            Method::LightTracer(p) | Method::Bidirectional(p) | Method::Vcm(p) => cut(&mut p.max_depth),
        }
    }
}
