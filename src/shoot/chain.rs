//! A Markov chain over photon paths: the random numbers of a path are its state, and it goes where photons are seen.

use super::walk::Deposit;
use super::{Guide, WalkSettings};
use crate::color::rgbe;
use crate::math::Vec2;
use crate::photon::Photon;
use crate::sample::{Key, Numbers, Purpose, Sampler, Sequence, hash_u64};
use crate::scene::Scene;

/// Numbers are kept as multiples of 2⁻²⁴, all that an `f32` below 1 can be, so that adding modulo 1 loses nothing: a step
/// and the step back are equally probable to the last bit.
const ONE: u32 = 1 << 24;

fn to_lattice(x: f32) -> u32 {
    (x * ONE as f32) as u32
}

fn from_lattice(x: u32) -> f32 {
    x as f32 * (1.0 / ONE as f32)
}

/// A stream that writes down what it gives out.
struct Recorded<'a> {
    stream: Sampler,
    numbers: &'a mut Vec<u32>,
}

impl Numbers for Recorded<'_> {
    fn next_1d(&mut self) -> f32 {
        let x = self.stream.next_1d();
        self.numbers.push(to_lattice(x));
        x
    }

    fn next_2d(&mut self) -> Vec2 {
        let x = self.stream.next_2d();
        self.numbers.extend(x.to_array().map(to_lattice));
        x
    }
}

/// The numbers of a path, each a step away from those of another: `u' = u ± ξ^(1/s + 1)` modulo 1
/// [Hachisuka and Jensen 2011, §4.3].
///
/// Where the other path was shorter, fresh numbers follow. That keeps the chain reversible: numbers that a path does not use
/// are uniform whatever the others are, so they may be forgotten and drawn anew.
struct Mutated<'a> {
    from: &'a [u32],
    numbers: &'a mut Vec<u32>,
    /// `1/s + 1`.
    exponent: f32,
    random: Sampler,
}

impl Numbers for Mutated<'_> {
    fn next_1d(&mut self) -> f32 {
        let random = self.random.next_2d();
        let number = match self.from.get(self.numbers.len()) {
            Some(&u) => {
                let step = to_lattice(random.x.powf(self.exponent));
                let step = if random.y < 0.5 { step } else { ONE - step };
                (u + step) % ONE
            }
            None => to_lattice(random.x),
        };
        self.numbers.push(number);
        from_lattice(number)
    }

    fn next_2d(&mut self) -> Vec2 {
        let x = self.next_1d();
        Vec2::new(x, self.next_1d())
    }
}

/// A path and its photons that are seen.
#[derive(Clone, Debug, Default)]
struct State {
    numbers: Vec<u32>,
    photons: Vec<Photon>,
}

/// What all chains of a pass have in common.
pub(super) struct Chain<'a, S> {
    pub scene: &'a Scene,
    pub guide: Option<&'a Guide>,
    /// Whether a photon adds to the picture.
    pub sees: &'a S,
    /// Of the uniform paths.
    pub uniform: Key,
    pub sequence: Sequence,
    /// Of the chains.
    pub key: Key,
    /// The `s` of the mutations.
    pub size: f64,
    pub mutations: u64,
    /// What the photons of a state count for each of the steps that the chain stays there.
    pub scale: f32,
}

/// What a chain has found.
#[derive(Debug)]
pub(super) struct Found {
    pub photons: Vec<Photon>,
    /// Proposals that became states.
    pub accepted: u64,
    /// Counts rays and photons that could not be stored.
    pub deposit: Deposit,
}

impl<S: Fn(&Photon) -> bool> Chain<'_, S> {
    /// Chain number `chain`, from the uniform path `start` on. Its states are those after each of its mutations.
    ///
    /// Every path that has a photon that is seen is as good as any other, so a proposal is taken if it has one and refused
    /// if not. The photons of a state are stored once, and count as often as the chain was there.
    pub fn run(&self, chain: u64, start: u64, walk: WalkSettings, emitted: u64, target: super::Target) -> Found {
        let key = self.key.with(chain);
        let mut found = Found { photons: Vec::new(), accepted: 0, deposit: Deposit::new(target, walk, emitted) };
        let mut state = State::default();
        let stream = Sampler::new(self.sequence, self.uniform, start);
        let recorded = Recorded { stream, numbers: &mut state.numbers };
        found.deposit.trace_with(self.scene, self.guide, recorded, self.uniform, start);
        self.take_seen(&mut found.deposit, &mut state);
        let mut proposal = State::default();
        let exponent = (1.0 / self.size + 1.0) as f32;
        let mut stay = 0;
        for step in 0..self.mutations {
            proposal.numbers.clear();
            let random = Sampler::new(Sequence::Independent, key, step);
            let numbers = Mutated { from: &state.numbers, numbers: &mut proposal.numbers, exponent, random };
            found.deposit.trace_with(self.scene, self.guide, numbers, key, step);
            self.take_seen(&mut found.deposit, &mut proposal);
            if !proposal.photons.is_empty() {
                self.store(&mut found, &state, stay, key.with(step));
                std::mem::swap(&mut state, &mut proposal);
                found.accepted += 1;
                stay = 0;
            }
            stay += 1;
        }
        self.store(&mut found, &state, stay, key.with(self.mutations));
        found
    }

    /// Moves the photons that are seen from the deposit to a state.
    fn take_seen(&self, deposit: &mut Deposit, state: &mut State) {
        state.photons.clear();
        state.photons.extend(deposit.photons.drain(..).filter(|photon| (self.sees)(photon)));
    }

    /// Stores the photons of a state in which the chain was for `stay` steps.
    fn store(&self, found: &mut Found, state: &State, stay: u64, key: Key) {
        if stay == 0 {
            return;
        }
        let factor = self.scale * stay as f32;
        for (i, photon) in state.photons.iter().enumerate() {
            match scaled(photon, factor, key.with(i as u64)) {
                Some(photon) => found.photons.push(photon),
                None => found.deposit.rejected += 1,
            }
        }
    }
}

/// A photon of `factor` times the power, rounded so that the mean is exact; `None` if that cannot be stored.
pub(super) fn scaled(photon: &Photon, factor: f32, key: Key) -> Option<Photon> {
    let power = rgbe::unpack(photon.power) * factor;
    Some(Photon { power: rgbe::pack(power, hash_u64(key.0, Purpose::Quantize as u64))?, ..*photon })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 10⁶ steps from one number: as many up as down (4.5 σ), and half of them below 2^−(1/s + 1).
    #[test]
    fn steps_are_symmetric_and_of_the_size_asked_for() {
        const STEPS: u64 = 1 << 20;
        let from = to_lattice(0.3);
        for size in [0.1, 1.0, 4.0] {
            let exponent = (1.0 / size + 1.0) as f32;
            let (mut up, mut moved, mut small) = (0u64, 0u64, 0u64);
            for step in 0..STEPS {
                let mut numbers = Vec::new();
                let random = Sampler::new(Sequence::Independent, Key::new(1, Purpose::Test, 0), step);
                Mutated { from: &[from], numbers: &mut numbers, exponent, random }.next_1d();
                let forward = (numbers[0] + ONE - from) % ONE;
                // Steps of more than a half come from the other side.
                let length = forward.min(ONE - forward) as f32 / ONE as f32;
                up += u64::from(forward > 0 && 2 * forward < ONE);
                moved += u64::from(forward > 0);
                small += u64::from(length < 0.5f32.powf(exponent));
            }
            let deviation = |n: f64, of: u64| (n - 0.5 * of as f64) / (0.25 * of as f64).sqrt();
            assert!(deviation(up as f64, moved).abs() < 4.5, "s = {size}: {up} of {moved} up");
            // ξ beyond 1 − 2^−(1/s + 1) wraps around to a short step as well.
            let wrapped = 1.0 - (1.0 - 0.5f64.powf(exponent as f64)).powf(1.0 / exponent as f64);
            let excess = small as f64 - wrapped * STEPS as f64;
            assert!(deviation(excess, STEPS).abs() < 4.5, "s = {size}: {small} of {STEPS} short, {wrapped} wrapped");
        }
    }

    #[test]
    fn what_is_written_down_is_what_was_given_out() {
        let stream = Sampler::new(Sequence::Sobol, Key::new(1, Purpose::Test, 0), 5);
        let (mut numbers, mut again) = (Vec::new(), stream);
        let mut recorded = Recorded { stream, numbers: &mut numbers };
        let given = [recorded.next_2d().to_array(), recorded.next_2d().to_array()].concat();
        assert_eq!(given, [again.next_2d().to_array(), again.next_2d().to_array()].concat());
        assert_eq!(numbers.iter().map(|&n| from_lattice(n)).collect::<Vec<_>>(), given);
    }
}
