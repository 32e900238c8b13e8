//! What the scene file says of photons: `photon_share` of lights and `photon_target` of shapes.

use super::super::xml::{Child, Query};
use super::super::{PhotonShare, PhotonTarget, Position, SceneError};
use super::Loader;
use crate::bsdf::{LobeMask, MaterialId, may_have};
use crate::light::LightSelector;

impl Loader<'_> {
    /// The share of the photons that the emitter of light number `light` asks for.
    pub(super) fn photon_share(&self, child: &Child, light: usize) -> Result<Option<PhotonShare>, SceneError> {
        let q = Query::new(self.doc, child.node);
        let Some(share) = super::emitters::photon_share(&q)? else { return Ok(None) };
        if share == 0.0 {
            let lost = "the light emits no photons: what it lights through mirrors, glass and other surfaces is missing \
                        from photon maps and light paths";
            self.doc.warn(q.pos("photon_share"), lost);
        }
        let label = format!("{} light in line {}", q.plugin(), q.node().pos.line);
        Ok(Some(PhotonShare { light: light as u32, share, label }))
    }

    /// Refuses shares of more than all photons, and of all where other lights need some.
    pub(super) fn check_shares(&self, shares: &[PhotonShare], selector: &LightSelector) -> Result<(), SceneError> {
        // What rounding leaves of decimal fractions that add up to 1.
        const ROUNDING: f64 = 1e-9;
        let error = |message: String| Err(SceneError::at(&self.doc.node(self.doc.root()).pos, message));
        let sum: f64 = shares.iter().map(|s| s.share).sum();
        if sum > 1.0 + ROUNDING {
            return error(format!("the lights ask for a \"photon_share\" of {sum} together"))
                .map_err(|e: SceneError| e.help("the shares must add up to 1 at most"));
        }
        let mut fixed = vec![false; selector.len()];
        shares.iter().for_each(|s| fixed[s.light as usize] = true);
        let others = (0..selector.len()).filter(|&i| selector.pmf(i) > 0.0 && !fixed[i]).count();
        if others > 0 && sum > 1.0 - ROUNDING && !shares.is_empty() {
            return error(format!("\"photon_share\" leaves no photons for {others} other lights"))
                .map_err(|e: SceneError| e.help("lower the shares, or give the other lights a \"photon_share\" of 0"));
        }
        Ok(())
    }

    /// Shape number `shape` as a target of photons; one that focuses no light is told to be none.
    pub(super) fn photon_target(
        &self,
        importance: f32,
        material: MaterialId,
        shape: usize,
        pos: &Position,
    ) -> PhotonTarget {
        if !may_have(&self.materials, material, LobeMask::SPECULAR) {
            self.doc.warn(pos, "\"photon_target\" has no effect: the shape is neither a mirror nor glass");
        }
        PhotonTarget { shape: shape as u32, importance, label: format!("shape in line {}", pos.line) }
    }
}
