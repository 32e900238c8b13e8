use glam::{Vec2, Vec3};

use super::dielectric::adjoint;
use super::diffuse::DiffuseBsdf;
use super::lobe::{Kind, Lobe, LobeMask};
use crate::color::Rgb;

/// The most lobes that a flattened material may have; [`check`](super::check) refuses scenes with more.
pub const MAX_LOBES: usize = 8;

/// Which quantity a walk carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The walk started at the camera and looks up radiance: refraction scales by `1/η²`.
    Radiance,
    /// The walk started at a light and carries power: no such scale, but Veach's factor for shading normals.
    Importance,
}

/// A direction chosen by [`Bsdf::sample`].
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    pub wi: Vec3,
    /// `f·|cos θi| / pdf`, the probability of the lobe included.
    pub weight: Rgb,
    /// Density per steradian over all lobes of the mask; for delta and null lobes the discrete probability.
    pub pdf: f32,
    /// The one class that was sampled.
    pub lobe: LobeMask,
    /// Index of the medium of `wi` over that of `wo`; 1 for reflection.
    pub eta: f32,
    /// True when `wi` is on the other side of the surface.
    pub transmit: bool,
}

impl BsdfSample {
    /// The weight of a discrete choice before it is divided by its probability.
    #[inline]
    fn undivided(self) -> Self {
        Self { weight: self.weight * self.pdf, ..self }
    }

    /// Whether this, undivided, is the choice that `chosen` made: lobes of a blend may share a direction, and differ in what
    /// they send there.
    fn is_part_of(&self, chosen: &Self) -> bool {
        let (a, b) = (self.weight.mean(), chosen.weight.mean() * chosen.pdf);
        self.lobe == chosen.lobe && self.wi == chosen.wi && (a - b).abs() <= 1e-4 * a
    }
}

/// A material at one point: everything looked up, sides decided for the `wo` of that point.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant)] // Copy without allocation; the small variants are written and read as such.
pub enum Bsdf {
    /// Absorbs everything: the back of a one-sided material.
    Black,
    /// Lambertian and nothing else.
    Diffuse(DiffuseBsdf),
    /// One lobe.
    Single(Single),
    /// Several.
    Layers(Layers),
}

/// The normals of the surface itself, before bump and normal maps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Normals {
    pub ng: Vec3,
    pub ns: Vec3,
}

/// A single lobe.
#[derive(Clone, Copy, Debug)]
pub struct Single {
    pub(super) normals: Normals,
    pub(super) lobe: Lobe,
}

/// Several lobes.
#[derive(Clone, Copy, Debug)]
pub struct Layers {
    pub(super) normals: Normals,
    pub(super) len: u8,
    pub(super) classes: LobeMask,
    pub(super) lobes: [Lobe; MAX_LOBES],
}

impl Layers {
    #[inline]
    fn lobes(&self) -> &[Lobe] {
        &self.lobes[..self.len as usize]
    }
}

impl Bsdf {
    /// The classes of all lobes.
    #[inline]
    pub fn lobes(&self) -> LobeMask {
        match self {
            Self::Black => LobeMask::NONE,
            Self::Diffuse(_) => LobeMask::DIFFUSE,
            Self::Single(s) => s.lobe.class,
            Self::Layers(l) => l.classes,
        }
    }

    /// `f(wo, wi)·|cos(wi, ns)|` per steradian of the lobes in `mask`, never of delta or null ones. Zero where geometric
    /// and shading normal disagree about the side of a direction.
    #[inline(always)]
    pub fn eval(&self, wo: Vec3, wi: Vec3, mode: Mode, mask: LobeMask) -> Rgb {
        match self {
            Self::Diffuse(d) if mask.intersects(LobeMask::DIFFUSE) => d.eval(wo, wi, mode),
            _ => self.eval_other(wo, wi, mode, mask),
        }
    }

    /// [`Bsdf::eval`] of what is not Lambertian alone. Apart, so that the short case is inlined: taking its result
    /// through memory costs more than computing it.
    #[inline(never)]
    fn eval_other(&self, wo: Vec3, wi: Vec3, mode: Mode, mask: LobeMask) -> Rgb {
        match self {
            Self::Black | Self::Diffuse(_) => Rgb::BLACK,
            Self::Single(s) => s.lobe.eval(&s.normals, wo, wi, mode, mask),
            Self::Layers(l) => l.lobes().iter().map(|lobe| lobe.eval(&l.normals, wo, wi, mode, mask)).sum(),
        }
    }

    /// Density per steradian with which [`sample`](Self::sample) picks `wi` from `mask`.
    #[inline(always)]
    pub fn pdf(&self, wo: Vec3, wi: Vec3, _mode: Mode, mask: LobeMask) -> f32 {
        match self {
            Self::Diffuse(d) if mask.intersects(LobeMask::DIFFUSE) => d.pdf(wo, wi),
            _ => self.pdf_other(wo, wi, mask),
        }
    }

    #[inline(never)]
    fn pdf_other(&self, wo: Vec3, wi: Vec3, mask: LobeMask) -> f32 {
        match self {
            Self::Black | Self::Diffuse(_) => 0.0,
            Self::Single(s) if mask.intersects(s.lobe.class) => s.lobe.pdf(&s.normals, wo, wi),
            Self::Single(_) => 0.0,
            Self::Layers(l) => l.pdf(wo, wi, mask),
        }
    }

    /// [`eval`](Self::eval) over all lobes, with the densities of `wi` from `wo` and of `wo` from `wi`: cheaper than one by
    /// one.
    #[inline(always)]
    pub fn eval_with_pdfs(&self, wo: Vec3, wi: Vec3, mode: Mode) -> (Rgb, f32, f32) {
        match self {
            Self::Diffuse(d) => (d.eval(wo, wi, mode), d.pdf(wo, wi), d.pdf(wi, wo)),
            Self::Layers(l) => l.eval_with_pdfs(wo, wi, mode),
            _ => {
                let pdf = |wo, wi| self.pdf_other(wo, wi, LobeMask::ALL);
                (self.eval_other(wo, wi, mode, LobeMask::ALL), pdf(wo, wi), pdf(wi, wo))
            }
        }
    }

    /// Picks a direction from the lobes of `mask`; `None` when there is nothing to pick or the direction leaks through
    /// the geometry.
    #[inline(always)]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode, mask: LobeMask) -> Option<BsdfSample> {
        match self {
            Self::Diffuse(d) if mask.intersects(LobeMask::DIFFUSE) => d.sample(wo, u, mode),
            _ => self.sample_other(wo, u_lobe, u, mode, mask),
        }
    }

    #[inline(never)]
    fn sample_other(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode, mask: LobeMask) -> Option<BsdfSample> {
        match self {
            Self::Black | Self::Diffuse(_) => None,
            Self::Single(s) if mask.intersects(s.lobe.class) => s.lobe.sample(&s.normals, wo, u_lobe, u, mode),
            Self::Single(_) => None,
            Self::Layers(l) => l.sample(wo, u_lobe, u, mode, mask),
        }
    }

    /// Probability with which [`sample`](Self::sample) makes the discrete choice (delta or null) of class `class` that
    /// reflects, or with `transmit` goes through the surface.
    pub fn discrete_pdf(&self, wo: Vec3, class: LobeMask, transmit: bool) -> f32 {
        match self {
            Self::Black | Self::Diffuse(_) => 0.0,
            Self::Single(s) => s.lobe.discrete_pdf(wo, class, transmit),
            Self::Layers(l) => {
                let (shares, total) = l.shares(wo, LobeMask::ALL);
                let sum: f32 =
                    l.lobes().iter().zip(shares).map(|(lobe, s)| s * lobe.discrete_pdf(wo, class, transmit)).sum();
                if total > 0.0 { sum / total } else { 0.0 }
            }
        }
    }

    /// Whether delta and null lobes may leave more than one way to go on.
    #[inline]
    pub fn has_discrete_ways(&self) -> bool {
        let ways = |lobe: &Lobe| match lobe.kind {
            _ if lobe.class.intersects(LobeMask::SMOOTH) => 0,
            Kind::Dielectric(_) => 2,
            _ => 1,
        };
        match self {
            Self::Black | Self::Diffuse(_) => false,
            Self::Single(s) => ways(&s.lobe) > 1,
            Self::Layers(l) => l.lobes().iter().map(ways).sum::<u32>() > 1,
        }
    }

    /// Shows all that delta and null lobes can do with what comes from `wo`, but for the way `chosen` that
    /// [`sample`](Self::sample) went, and tells whether that is among them. Every sample's weight is the whole share that goes
    /// its way, not divided by the probability of the choice.
    pub fn other_discrete_ways(
        &self,
        wo: Vec3,
        u: Vec2,
        mode: Mode,
        chosen: Option<&BsdfSample>,
        mut show: impl FnMut(BsdfSample),
    ) -> bool {
        let chosen = chosen.filter(|c| !c.lobe.intersects(LobeMask::SMOOTH));
        let (normals, lobes) = match self {
            Self::Black | Self::Diffuse(_) => return false,
            Self::Single(s) => (&s.normals, std::slice::from_ref(&s.lobe)),
            Self::Layers(l) => (&l.normals, l.lobes()),
        };
        // What one lobe of two ways has left.
        if let ([lobe @ Lobe { kind: Kind::Dielectric(_), .. }], Some(c)) = (lobes, chosen) {
            let other = lobe.sample(normals, wo, if c.transmit { 0.0 } else { 1.0 }, u, mode);
            other.filter(|s| s.transmit != c.transmit).map(BsdfSample::undivided).into_iter().for_each(show);
            return true;
        }
        let mut found = false;
        let mut see = |s: BsdfSample| match chosen {
            Some(c) if !found && s.is_part_of(c) => found = true,
            _ => show(s),
        };
        for lobe in lobes.iter().filter(|lobe| !lobe.class.intersects(LobeMask::SMOOTH)) {
            match lobe.kind {
                Kind::Dielectric(_) => {
                    // The lower numbers reflect, the upper ones go through.
                    let low = lobe.sample(normals, wo, 0.0, u, mode);
                    let high = lobe.sample(normals, wo, 1.0, u, mode);
                    let high = high.filter(|h| low.is_none_or(|l| l.transmit != h.transmit));
                    low.into_iter().chain(high).map(BsdfSample::undivided).for_each(&mut see);
                }
                // One way, or one of many.
                _ => {
                    let s = lobe.sample(normals, wo, 0.0, u, mode);
                    s.map(|s| if lobe.kind.is_discrete() { s.undivided() } else { s }).into_iter().for_each(&mut see);
                }
            }
        }
        found
    }

    /// Estimate of the share of power arriving from `wo` that the lobes of `mask` scatter; exact for diffuse and delta.
    pub fn albedo(&self, wo: Vec3, mask: LobeMask) -> Rgb {
        match self {
            Self::Black => Rgb::BLACK,
            Self::Diffuse(d) if mask.intersects(LobeMask::DIFFUSE) => d.albedo(wo),
            Self::Diffuse(_) => Rgb::BLACK,
            Self::Single(s) => s.lobe.masked_albedo(wo, mask),
            Self::Layers(l) => l.lobes().iter().map(|lobe| lobe.masked_albedo(wo, mask)).sum(),
        }
    }

    /// The albedo, if the lobes of `mask` are exactly Lambertian about the geometric normal.
    #[inline]
    pub fn lambertian(&self, mask: LobeMask) -> Option<Rgb> {
        match self {
            Self::Diffuse(d) if mask.intersects(LobeMask::DIFFUSE) => d.flat_albedo(),
            _ => None,
        }
    }

    /// The albedo and the shading normal on the side of `wo`, if the surface is Lambertian and nothing else: radiance is
    /// then albedo/π times the irradiance about that normal.
    #[inline]
    pub fn diffuse_only(&self, wo: Vec3) -> Option<(Rgb, Vec3)> {
        match self {
            Self::Diffuse(d) => d.seen_from(wo),
            _ => None,
        }
    }

    /// True when a lobe of `mask` can send light to the other side of the surface.
    #[inline]
    pub fn transmits(&self, mask: LobeMask) -> bool {
        match self {
            Self::Black | Self::Diffuse(_) => false,
            Self::Single(s) => mask.intersects(s.lobe.class) && s.lobe.kind.transmits(),
            Self::Layers(l) => l.lobes().iter().any(|lobe| mask.intersects(lobe.class) && lobe.kind.transmits()),
        }
    }

    /// What goes straight through the surface: the weight of the null lobes, for shadow rays that pass masks.
    pub fn transmittance(&self, wo: Vec3) -> Rgb {
        self.albedo(wo, LobeMask::NULL)
    }
}

/// A pair of directions in a lobe's frame, with their cosines to the geometric normal.
struct Local {
    wo: Vec3,
    wi: Vec3,
    wo_ng: f32,
    wi_ng: f32,
}

impl Local {
    /// True when both normals put each direction on the same side.
    #[inline]
    fn sides_agree(&self) -> bool {
        self.wo.z * self.wo_ng > 0.0 && self.wi.z * self.wi_ng > 0.0
    }

    /// Veach's factor for walks that start at a light [Veach 1997, eq. 5.19], 1 otherwise.
    #[inline]
    fn adjoint(&self, mode: Mode) -> f32 {
        adjoint((self.wo.z, self.wo_ng), (self.wi.z, self.wi_ng), mode)
    }
}

impl Lobe {
    /// The geometric normal on the side that this lobe's shading normal is on.
    #[inline]
    fn oriented(&self, ng: Vec3) -> Vec3 {
        if self.frame.n.dot(ng) < 0.0 { -ng } else { ng }
    }

    #[inline]
    fn local(&self, normals: &Normals, wo: Vec3, wi: Vec3) -> Local {
        let ng = self.oriented(normals.ng);
        Local { wo: self.frame.to_local(wo), wi: self.frame.to_local(wi), wo_ng: ng.dot(wo), wi_ng: ng.dot(wi) }
    }

    /// The factor that makes up for what a map's normals hide: shadowing towards the light as over facets whose slopes
    /// are those of the map [Conty Estevez, Lecocq, Stein 2019, eqs. 1-3].
    #[inline]
    fn shadowing(&self, normals: &Normals, wo: Vec3, wi: Vec3, mode: Mode) -> f32 {
        if self.shadow == 0.0 {
            return 1.0;
        }
        let to_light = match mode {
            Mode::Radiance => wi,
            Mode::Importance => wo,
        };
        let c = normals.ns.dot(to_light);
        let tan_sq = (1.0 - c * c).max(0.0) / (c * c);
        2.0 / (1.0 + (1.0 + self.shadow * tan_sq).sqrt())
    }

    #[inline]
    fn eval(&self, normals: &Normals, wo: Vec3, wi: Vec3, mode: Mode, mask: LobeMask) -> Rgb {
        if !mask.intersects(self.class & LobeMask::SMOOTH) {
            return Rgb::BLACK;
        }
        let l = self.local(normals, wo, wi);
        if !l.sides_agree() {
            return Rgb::BLACK;
        }
        self.kind.eval(l.wo, l.wi, mode) * (self.weight * l.adjoint(mode) * self.shadowing(normals, wo, wi, mode))
    }

    #[inline]
    fn pdf(&self, normals: &Normals, wo: Vec3, wi: Vec3) -> f32 {
        if !self.class.intersects(LobeMask::SMOOTH) {
            return 0.0;
        }
        let l = self.local(normals, wo, wi);
        if l.sides_agree() { self.kind.pdf(l.wo, l.wi) } else { 0.0 }
    }

    #[inline]
    fn sample(&self, normals: &Normals, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode) -> Option<BsdfSample> {
        // Straight on means exactly straight on, whatever the frame rounds to.
        if self.class == LobeMask::NULL {
            let weight = self.masked_albedo(wo, LobeMask::NULL);
            return Some(BsdfSample { wi: -wo, weight, pdf: 1.0, lobe: LobeMask::NULL, eta: 1.0, transmit: true });
        }
        // What is the same in all directions needs no tangents.
        let (ns, ng) = (self.frame.n, normals.ng);
        let plain = match &self.kind {
            Kind::Dielectric(interface) => Some(interface.sample(ns, ng, wo, u_lobe, mode)?),
            Kind::Mirror(mirror) => Some(mirror.metal().sample(ns, ng, wo, u, mode)?),
            Kind::RoughConductor(rough) => match rough.metal() {
                Some(metal) => Some(metal.sample(ns, ng, wo, u, mode)?),
                None => None,
            },
            _ => None,
        };
        if let Some(s) = plain {
            let weight = s.weight * (self.weight * self.shadowing(normals, wo, s.wi, mode));
            return Some(BsdfSample { weight, lobe: self.class, ..s });
        }
        let s = self.kind.sample(self.frame.to_local(wo), u_lobe, u, mode)?;
        let wi = self.frame.to_world(s.wi).normalize();
        let l = self.local(normals, wo, wi);
        (l.sides_agree() && s.pdf > 0.0).then(|| BsdfSample {
            wi,
            weight: s.weight * (self.weight * l.adjoint(mode) * self.shadowing(normals, wo, wi, mode)),
            pdf: s.pdf,
            lobe: self.class,
            eta: s.eta,
            transmit: s.transmit,
        })
    }

    fn discrete_pdf(&self, wo: Vec3, class: LobeMask, transmit: bool) -> f32 {
        if self.class == class { self.kind.discrete_pdf(self.frame.to_local(wo), transmit) } else { 0.0 }
    }

    #[inline]
    fn masked_albedo(&self, wo: Vec3, mask: LobeMask) -> Rgb {
        if mask.intersects(self.class) { self.kind.albedo(self.frame.to_local(wo)) * self.weight } else { Rgb::BLACK }
    }
}

impl Layers {
    /// How often each lobe is chosen, in proportion to its estimated albedo; unnormalised, with the sum.
    #[inline]
    fn shares(&self, wo: Vec3, mask: LobeMask) -> ([f32; MAX_LOBES], f32) {
        let mut shares = [0.0; MAX_LOBES];
        let mut total = 0.0;
        for (share, lobe) in shares.iter_mut().zip(self.lobes()) {
            // The mean of the channels, so that a saturated lobe is not over-sampled.
            *share = lobe.masked_albedo(wo, mask).mean();
            total += *share;
        }
        (shares, total)
    }

    fn pdf(&self, wo: Vec3, wi: Vec3, mask: LobeMask) -> f32 {
        let (shares, total) = self.shares(wo, mask);
        if total <= 0.0 {
            return 0.0;
        }
        let sum: f32 = self
            .lobes()
            .iter()
            .zip(shares)
            .filter(|(_, s)| *s > 0.0)
            .map(|(l, s)| s * l.pdf(&self.normals, wo, wi))
            .sum();
        sum / total
    }

    /// As [`Bsdf::eval_with_pdfs`].
    #[inline(never)]
    fn eval_with_pdfs(&self, wo: Vec3, wi: Vec3, mode: Mode) -> (Rgb, f32, f32) {
        let mut value = Rgb::BLACK;
        // Sums of densities by the shares of the lobes, and the sums of the shares.
        let (mut there, mut back) = ((0.0, 0.0), (0.0, 0.0));
        for lobe in self.lobes() {
            let l = lobe.local(&self.normals, wo, wi);
            let share = |w| (lobe.kind.albedo(w) * lobe.weight).mean();
            let (share_there, share_back) = (share(l.wo), share(l.wi));
            there.1 += share_there;
            back.1 += share_back;
            if lobe.class.intersects(LobeMask::SMOOTH) && l.sides_agree() {
                let (f, pdf_there, pdf_back) = lobe.kind.eval_with_pdfs(l.wo, l.wi, mode);
                value += f * (lobe.weight * l.adjoint(mode) * lobe.shadowing(&self.normals, wo, wi, mode));
                there.0 += share_there * pdf_there;
                back.0 += share_back * pdf_back;
            }
        }
        let density = |(sum, shares): (f32, f32)| if shares > 0.0 { sum / shares } else { 0.0 };
        (value, density(there), density(back))
    }

    fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, mode: Mode, mask: LobeMask) -> Option<BsdfSample> {
        // Choose a lobe and stretch what is left of the number to [0, 1).
        let (shares, total) = self.shares(wo, mask);
        let mut x = u_lobe * total;
        let last = shares.iter().rposition(|&s| s > 0.0)?;
        let chosen = (0..last).find(|&i| {
            let here = x < shares[i];
            x -= if here { 0.0 } else { shares[i] };
            here
        });
        let chosen = chosen.unwrap_or(last);
        let p = shares[chosen] / total;
        let u_rest = (x / shares[chosen]).clamp(0.0, 1.0 - f32::EPSILON / 2.0);

        // Sample it; a discrete choice stands for itself.
        let lobe = &self.lobes[chosen];
        let mut s = lobe.sample(&self.normals, wo, u_rest, u, mode)?;
        if !lobe.class.intersects(LobeMask::SMOOTH) {
            return Some(BsdfSample { weight: s.weight / p, pdf: s.pdf * p, ..s });
        }

        // Any lobe could have picked this direction: sum over all of them.
        let (mut f, mut pdf) = (Rgb::BLACK, 0.0);
        for (l, share) in self.lobes().iter().zip(shares) {
            f += l.eval(&self.normals, wo, s.wi, mode, mask);
            if share > 0.0 {
                pdf += share * l.pdf(&self.normals, wo, s.wi);
            }
        }
        s.pdf = pdf / total;
        s.weight = f / s.pdf;
        (s.pdf > 0.0).then_some(s)
    }
}

/// Makes a [`Bsdf`] of lobes that `evaluate` collects.
pub(super) fn from_lobes(normals: Normals, lobes: &[Lobe]) -> Bsdf {
    match lobes {
        [] => Bsdf::Black,
        [Lobe { kind: Kind::Lambert(l), weight, frame, shadow: 0.0, .. }] => {
            let ng = if frame.n.dot(normals.ng) < 0.0 { -normals.ng } else { normals.ng };
            Bsdf::Diffuse(DiffuseBsdf { ns: frame.n, ng, reflectance: l.reflectance * *weight })
        }
        [lobe] => Bsdf::Single(Single { normals, lobe: *lobe }),
        [first, ..] => {
            let classes = lobes.iter().fold(LobeMask::NONE, |set, lobe| set | lobe.class);
            let mut layers = Layers { normals, len: lobes.len() as u8, classes, lobes: [*first; MAX_LOBES] };
            layers.lobes[..lobes.len()].copy_from_slice(lobes);
            Bsdf::Layers(layers)
        }
    }
}
