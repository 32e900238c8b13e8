//! Adding up checkpoints of different passes.

use super::super::spread::Spread;
use super::{Checkpoint, CheckpointError};

impl Checkpoint {
    /// The sum of checkpoints of the same scene and plan that have no pass in common: the picture of all their passes,
    /// each with the weight of its samples.
    ///
    /// Sums are f64 and added in the order of the passes, so the result does not depend on the order of the arguments. A
    /// single run adds pass by pass instead: its image differs by rounding of f64, far below 1e-6 relative.
    pub fn merge(mut parts: Vec<Self>) -> Result<Self, CheckpointError> {
        parts.sort_by_key(|p| p.ranges.first().map_or((0, 0), |r| (r.start, r.end)));
        let mut parts = parts.into_iter();
        let mut sum = parts.next().ok_or(CheckpointError::Nothing)?;
        for part in parts {
            sum.add(part)?;
        }
        Ok(sum)
    }

    fn add(&mut self, o: Self) -> Result<(), CheckpointError> {
        // Refuse what does not belong together.
        if o.scene_hash != self.scene_hash {
            return Err(CheckpointError::Scene { found: o.scene_hash, expected: self.scene_hash.clone() });
        }
        if o.plan != self.plan {
            return Err(CheckpointError::Plan { found: o.plan, expected: self.plan.clone() });
        }
        if o.layers() != self.layers() {
            return Err(CheckpointError::Layers { found: o.layers(), expected: self.layers() });
        }
        if !self.independent {
            return Err(CheckpointError::Dependent);
        }
        self.add_ranges(&o)?;
        // Add the sums.
        let mut film = self.film();
        film.add(&o.film());
        self.film = film.state();
        let mut layers = self.layer_films();
        layers.add(&o.layer_films());
        self.layers = layers.states();
        if let (Some(doubt), Some(other)) = (&mut self.doubt, &o.doubt) {
            add_spread(&mut doubt.pixels, &other.pixels);
            add_spread(&mut doubt.blocks, &other.blocks);
            if let (Some(bias), Some(other)) = (&mut doubt.bias, &other.bias) {
                add_spread(&mut bias.pixels, &other.pixels);
                add_spread(&mut bias.corrected_blocks, &other.corrected_blocks);
            }
        }
        self.spp += o.spp;
        self.counters += o.counters;
        for map in o.maps {
            match self.maps.iter_mut().find(|m| m.name == map.name) {
                Some(m) => {
                    m.emitted += map.emitted;
                    m.stored += map.stored;
                    m.rejected += map.rejected;
                    m.energy += map.energy;
                    m.aimed += &map.aimed;
                    m.energy_error = m.energy.relative_error();
                }
                None => self.maps.push(map),
            }
        }
        self.photon_memory = self.photon_memory.max(o.photon_memory);
        if o.accel != self.accel {
            self.accel = format!("{}; {}", self.accel, o.accel);
        }
        Ok(())
    }

    /// Takes in the passes of another checkpoint, unless one is there already; neighbouring ranges become one.
    fn add_ranges(&mut self, o: &Self) -> Result<(), CheckpointError> {
        for a in &self.ranges {
            for b in &o.ranges {
                if a.start < b.end && b.start < a.end {
                    return Err(CheckpointError::Overlap { first: a.clone(), second: b.clone() });
                }
            }
        }
        self.ranges.extend(o.ranges.iter().cloned());
        self.ranges.sort_by_key(|r| r.start);
        self.ranges.dedup_by(|next, previous| {
            let joins = next.start == previous.end;
            if joins {
                previous.end = next.end;
            }
            joins
        });
        Ok(())
    }
}

fn add_spread(sum: &mut Spread, o: &Spread) {
    sum.weight += o.weight;
    sum.square_weight += o.square_weight;
    sum.passes += o.passes;
    for (a, b) in sum.sum.iter_mut().chain(&mut sum.square).zip(o.sum.iter().chain(&o.square)) {
        for (a, b) in a.iter_mut().zip(b) {
            *a += b;
        }
    }
}
