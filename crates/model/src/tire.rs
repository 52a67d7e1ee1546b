//! Contact laws: the force that a tire draws from the ground when it slips. `[eq:tire]`
//!
//! Contact axes: x along the rim's rolling direction (or roller axis), y along the axle. The slip
//! velocity s is that of the contact patch over the ground, m/s; a law gives the force per normal load,
//! κ = f/N, on the robot. All of them are isotropic: combined slip stays within the friction circle.
//!
//! Laws with a state z, m, the deflection of bristles or of the carcass, follow ż = s − w z: at rest z
//! is a spring that holds the robot without creep, and in steady rolling z/σ is the normalised slip.

pub mod combined;
mod cubic;

pub use cubic::{Arcs, Onset};

use crate::dynamics::{Dynamics, Sizes};
use crate::planar::{Vec2, vec2};
use crate::scalar::Scalar;

/// A contact law, per unit of normal load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tire<T> {
    /// Coulomb friction with Stribeck's effect, rounded off about zero slip: κ = −μ(|s|) s/√(|s|² + ε²).
    /// It holds nothing at rest: on a slope it creeps.
    Coulomb {
        /// Friction coefficients in sliding and at its onset.
        friction: Friction<T>,
        /// ε: slip velocity over which it is rounded off, m/s.
        rounding: T,
    },
    /// Friction by two cubic arcs over the slip velocity: κ = −μ(|s|) s/|s|. It holds nothing at rest: on a
    /// slope it creeps.
    Cubic {
        /// μ.
        arcs: Arcs<T>,
    },
    /// LuGre: w = σ₀|s|/μ(|s|), κ = −(σ₀ z + σ₁ ż + σ₂ s).
    ///
    /// C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, *A new model for control of systems
    /// with friction*, IEEE Transactions on Automatic Control 40(3), 1995, here for two axes.
    Lugre {
        /// Friction coefficients in sliding and at its onset.
        friction: Friction<T>,
        /// σ₀, 1/m.
        stiffness: T,
        /// σ₁, s/m. The law takes energy at every instant as long as σ₁ |s| ≤ 4 μ.
        damping: T,
        /// σ₂, s/m.
        viscous: T,
    },
    /// A law of normalised slip behind a relaxation length.
    Slip {
        /// Force over normalised slip.
        curve: Curve<T>,
        /// σ: the way over which the force builds up, m.
        relaxation: T,
        /// Time by which the deflection's rate adds to it, s: what damps it at rest.
        damping: T,
    },
}

/// Friction coefficients: μ(s) = μ_c + (μ_s − μ_c) e^{−(s/v_s)²}.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction<T> {
    /// μ_c, in sliding.
    pub kinetic: T,
    /// μ_s, at its onset.
    pub breakaway: T,
    /// v_s: slip velocity over which the one becomes the other, m/s.
    pub stribeck: T,
}

/// Force per load over the normalised slip q = s/|r φ̇|, both as magnitudes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve<T> {
    /// The brush model with a parabolic pressure: μ (1 − (1 − Θ)³), Θ = C q/(3 μ), and μ from Θ = 1 on.
    ///
    /// E. Fiala, *Seitenkräfte am rollenden Luftreifen*, VDI-Zeitschrift 96, 1954.
    Brush {
        /// μ.
        friction: T,
        /// C, slip stiffness per load.
        stiffness: T,
    },
    /// The magic formula: μ sin(c atan(B q − E (B q − atan(B q)))), B = C/(c μ).
    ///
    /// H. B. Pacejka, *Tire and Vehicle Dynamics*, chapter 4.
    Magic {
        /// μ, the peak.
        friction: T,
        /// C, slip stiffness per load.
        stiffness: T,
        /// c, shape factor.
        shape: T,
        /// E, curvature factor.
        curvature: T,
    },
    /// C q within the friction circle.
    Linear {
        /// μ.
        friction: T,
        /// C, slip stiffness per load.
        stiffness: T,
    },
}

/// What a contact answers to a slip velocity, per load; [`Tire::respond`].
#[derive(Clone, Copy, Debug)]
pub struct Grip<T> {
    /// κ, contact axes.
    pub force: Vec2<T>,
    /// z at the end of the step, m.
    pub deflection: Vec2<T>,
    /// ∂κ/∂s, s/m, row by row.
    pub slope: [[T; 2]; 2],
}

impl<T: Scalar> Friction<T> {
    /// The same coefficient at rest and in sliding.
    pub fn plain(friction: T) -> Self {
        Friction {
            kinetic: friction,
            breakaway: friction,
            stribeck: T::one(),
        }
    }

    /// μ at a slip velocity, and dμ/d|s|, s/m.
    #[inline(always)]
    pub fn at(&self, speed: T) -> (T, T) {
        let ratio = speed / self.stribeck;
        let fade = (-(ratio * ratio)).exp() * (self.breakaway - self.kinetic);
        (
            self.kinetic + fade,
            T::from(-2.0) * ratio / self.stribeck * fade,
        )
    }
}

/// B q − E (B q − atan(B q)) of the magic formula, for B q and E.
#[inline(always)]
fn bend<T: Scalar>(bq: T, curvature: T) -> T {
    bq - curvature * (bq - bq.atan())
}

impl<T: Scalar> Curve<T> {
    /// Force per load at a slip of either sign along one axis: odd in it.
    #[inline(always)]
    pub fn along(&self, slip: T) -> T {
        self.at(slip.abs()).0 * T::one().copysign(slip)
    }

    /// Force per load at a normalised slip q ≥ 0, and its derivative.
    #[inline(always)]
    pub fn at(&self, q: T) -> (T, T) {
        match *self {
            Curve::Brush {
                friction,
                stiffness,
            } => {
                // 1 − (1 − Θ)³ without its cancellation.
                let three = T::from(3.0);
                let theta = (stiffness * q / (three * friction)).min(T::one());
                let left = T::one() - theta;
                (
                    friction * theta * (theta - three).mul_add(theta, three),
                    stiffness * left * left,
                )
            }
            Curve::Magic {
                friction,
                stiffness,
                shape,
                curvature,
            } => {
                let b = stiffness / (shape * friction);
                let bq = b * q;
                let inner = bend(bq, curvature);
                let (sin, cos) = (shape * inner.atan()).sin_cos();
                let bend = T::one() - curvature * (T::one() - T::one() / (T::one() + bq * bq));
                let slope = friction * cos * shape * b * bend / (T::one() + inner * inner);
                (friction * sin, slope)
            }
            Curve::Linear {
                friction,
                stiffness,
            } => {
                let force = stiffness * q;
                let slides = friction.less(force);
                (
                    T::select(slides, friction, force),
                    T::select(slides, T::zero(), stiffness),
                )
            }
        }
    }

    /// μ.
    #[inline(always)]
    pub fn friction(&self) -> T {
        match *self {
            Curve::Brush { friction, .. }
            | Curve::Magic { friction, .. }
            | Curve::Linear { friction, .. } => friction,
        }
    }

    /// C: the slope at zero slip.
    #[inline(always)]
    pub fn stiffness(&self) -> T {
        match *self {
            Curve::Brush { stiffness, .. }
            | Curve::Magic { stiffness, .. }
            | Curve::Linear { stiffness, .. } => stiffness,
        }
    }

    /// Normalised slip of a wheel that slides without turning: where the force no longer rises, and 1,
    /// that of a locked wheel, for the magic formula.
    #[inline(always)]
    pub fn sliding(&self) -> T {
        match *self {
            Curve::Brush {
                friction,
                stiffness,
            } => T::from(3.0) * friction / stiffness,
            Curve::Linear {
                friction,
                stiffness,
            } => friction / stiffness,
            Curve::Magic { .. } => T::one(),
        }
    }

    /// Force of the ground per load, contact axes, for a normalised slip in contact axes.
    #[inline(always)]
    pub fn force(&self, slip: Vec2<T>) -> Vec2<T> {
        let q = length(slip);
        let (force, _) = self.at(q);
        slip * -secant(force, q, self.stiffness())
    }
}

/// |v|, without a fault at zero.
#[inline(always)]
fn length<T: Scalar>(v: Vec2<T>) -> T {
    v.dot(v).sqrt()
}

/// a/b, or its limit where b vanishes.
#[inline(always)]
fn secant<T: Scalar>(a: T, b: T, limit: T) -> T {
    let regular = T::from(1e-150).less(b);
    T::select(regular, a / T::select(regular, b, T::one()), limit)
}

/// The unit vector along v, or zero.
#[inline(always)]
fn unit<T: Scalar>(v: Vec2<T>, size: T) -> Vec2<T> {
    v * secant(T::one(), size, T::zero())
}

impl<T: Scalar> Tire<T> {
    /// The same law in another scalar.
    pub fn map<U: Scalar>(&self, number: &mut dyn FnMut(T) -> U) -> Tire<U> {
        let rubbing = |f: &Friction<T>, number: &mut dyn FnMut(T) -> U| Friction {
            kinetic: number(f.kinetic),
            breakaway: number(f.breakaway),
            stribeck: number(f.stribeck),
        };
        match self {
            Tire::Coulomb { friction, rounding } => Tire::Coulomb {
                friction: rubbing(friction, number),
                rounding: number(*rounding),
            },
            Tire::Cubic { arcs } => Tire::Cubic {
                arcs: arcs.map(number),
            },
            Tire::Lugre {
                friction,
                stiffness,
                damping,
                viscous,
            } => Tire::Lugre {
                friction: rubbing(friction, number),
                stiffness: number(*stiffness),
                damping: number(*damping),
                viscous: number(*viscous),
            },
            Tire::Slip {
                curve,
                relaxation,
                damping,
            } => Tire::Slip {
                curve: match curve {
                    Curve::Brush {
                        friction,
                        stiffness,
                    } => Curve::Brush {
                        friction: number(*friction),
                        stiffness: number(*stiffness),
                    },
                    Curve::Magic {
                        friction,
                        stiffness,
                        shape,
                        curvature,
                    } => Curve::Magic {
                        friction: number(*friction),
                        stiffness: number(*stiffness),
                        shape: number(*shape),
                        curvature: number(*curvature),
                    },
                    Curve::Linear {
                        friction,
                        stiffness,
                    } => Curve::Linear {
                        friction: number(*friction),
                        stiffness: number(*stiffness),
                    },
                },
                relaxation: number(*relaxation),
                damping: number(*damping),
            },
        }
    }

    /// The largest force per load at the slip velocity of the contact; at any, for the cubic arcs.
    #[inline(always)]
    pub fn friction(&self, slip: Vec2<T>) -> T {
        match self {
            Tire::Coulomb { friction, .. } | Tire::Lugre { friction, .. } => {
                friction.at(length(slip)).0
            }
            Tire::Cubic { arcs } => arcs.breakaway,
            Tire::Slip { curve, .. } => curve.friction(),
        }
    }

    /// The same law on a ground of this friction coefficient, in place of its own in sliding.
    #[inline(always)]
    pub fn on_friction(&self, coefficient: T) -> Self {
        self.on(coefficient / self.kinetic())
    }

    /// Its friction coefficient in sliding, or at the peak.
    #[inline(always)]
    pub fn kinetic(&self) -> T {
        match self {
            Tire::Coulomb { friction, .. } | Tire::Lugre { friction, .. } => friction.kinetic,
            Tire::Cubic { arcs } => arcs.kinetic,
            Tire::Slip { curve, .. } => curve.friction(),
        }
    }

    /// The same law on a ground with another grip: `grip` times the friction.
    #[inline(always)]
    pub fn on(&self, grip: T) -> Self {
        let mut tire = *self;
        match &mut tire {
            Tire::Coulomb { friction, .. } | Tire::Lugre { friction, .. } => {
                friction.kinetic *= grip;
                friction.breakaway *= grip;
            }
            Tire::Cubic { arcs } => {
                arcs.breakaway *= grip;
                arcs.kinetic *= grip;
            }
            Tire::Slip { curve, .. } => match curve {
                Curve::Brush { friction, .. }
                | Curve::Magic { friction, .. }
                | Curve::Linear { friction, .. } => *friction *= grip,
            },
        }
        tire
    }

    /// w, 1/s, of ż = s − w z at a slip speed and a rolling speed |r φ̇|, m/s, and dw/d|s|.
    #[inline(always)]
    fn decay(&self, speed: T, rolling: T) -> (T, T) {
        match self {
            Tire::Coulomb { .. } | Tire::Cubic { .. } => (T::zero(), T::zero()),
            Tire::Lugre {
                friction,
                stiffness,
                ..
            } => {
                let (mu, slope) = friction.at(speed);
                let w = *stiffness * speed / mu;
                (w, (*stiffness - w * slope) / mu)
            }
            Tire::Slip {
                curve, relaxation, ..
            } => {
                let sliding = curve.sliding();
                let slides = rolling.less(speed / sliding);
                let fastest = T::select(slides, speed / sliding, rolling);
                let slope = T::select(slides, T::one() / sliding, T::zero());
                (fastest / *relaxation, slope / *relaxation)
            }
        }
    }

    /// ż, m/s, at an instant.
    #[inline(always)]
    pub fn rate(&self, slip: Vec2<T>, deflection: Vec2<T>, rolling: T) -> Vec2<T> {
        match self {
            Tire::Coulomb { .. } | Tire::Cubic { .. } => Vec2::zero(),
            _ => slip - deflection * self.decay(length(slip), rolling).0,
        }
    }

    /// Force per load at an instant, contact axes, for a slip velocity, m/s, a deflection, m, and a
    /// rolling speed |r φ̇|, m/s.
    #[inline(always)]
    pub fn force(&self, slip: Vec2<T>, deflection: Vec2<T>, rolling: T) -> Vec2<T> {
        let rate = self.rate(slip, deflection, rolling);
        match self {
            Tire::Coulomb { friction, rounding } => {
                let square = slip.dot(slip);
                let (mu, _) = friction.at(square.sqrt());
                slip * -(mu / rounding.mul_add(*rounding, square).sqrt())
            }
            Tire::Cubic { arcs } => slip * -arcs.chord(length(slip), rolling).0,
            Tire::Lugre {
                stiffness,
                damping,
                viscous,
                ..
            } => -(deflection * *stiffness + rate * *damping + slip * *viscous),
            Tire::Slip {
                curve,
                relaxation,
                damping,
            } => curve.force((deflection + rate * *damping) * (T::one() / *relaxation)),
        }
    }

    /// The contact at the end of a step of `step` s that began with `deflection`, by Euler's implicit
    /// rule, for the slip velocity at the end.
    #[inline(always)]
    pub fn respond(&self, slip: Vec2<T>, deflection: Vec2<T>, rolling: T, step: T) -> Grip<T> {
        let (zero, one) = (T::zero(), T::one());
        let square = slip.dot(slip);
        let speed = square.sqrt();
        let along = unit(slip, speed);
        if let Tire::Coulomb { friction, rounding } = self {
            let (mu, falls) = friction.at(speed);
            let size = rounding.mul_add(*rounding, square).sqrt();
            let secant = mu / size;
            // d(μ s/√)/ds: across it is the secant, along it falls off, and further by Stribeck.
            let share = secant * (square / (size * size)) - falls * speed / size;
            return Grip {
                force: slip * -secant,
                deflection,
                slope: radial(secant, share, along),
            };
        }
        if let Tire::Cubic { arcs } = self {
            let (chord, slope) = arcs.chord(speed, rolling);
            return Grip {
                force: slip * -chord,
                deflection,
                slope: radial(chord, chord - slope, along),
            };
        }
        let (w, falls) = self.decay(speed, rolling);
        let gain = one / step.mul_add(w, one);
        let end = (deflection + slip * step) * gain;
        let rate = slip - end * w;
        // ∂z/∂s = h (1 − z (∂w/∂s)ᵀ)/(1 + h w).
        let lag = step * gain;
        let turn = end * falls;
        let moves = [
            [
                lag * (one - turn.x * along.x),
                lag * (zero - turn.x * along.y),
            ],
            [
                lag * (zero - turn.y * along.x),
                lag * (one - turn.y * along.y),
            ],
        ];
        // ż = (z − z₀)/h.
        let per_step = one / step;
        match self {
            Tire::Coulomb { .. } | Tire::Cubic { .. } => unreachable!("handled above"),
            Tire::Lugre {
                stiffness,
                damping,
                viscous,
                ..
            } => {
                let hard = damping.mul_add(per_step, *stiffness);
                let mut slope = moves.map(|row| row.map(|entry| -(hard * entry)));
                slope[0][0] += -*viscous;
                slope[1][1] += -*viscous;
                Grip {
                    force: -(end * *stiffness + rate * *damping + slip * *viscous),
                    deflection: end,
                    slope,
                }
            }
            Tire::Slip {
                curve,
                relaxation,
                damping,
            } => {
                let per_length = one / *relaxation;
                let q = (end + rate * *damping) * per_length;
                let size = length(q);
                let (force, slope) = curve.at(size);
                let chord = secant(force, size, curve.stiffness());
                let bent = radial(chord, chord - slope, unit(q, size));
                let hard = damping.mul_add(per_step, one) * per_length;
                let entry = |a: usize, b: usize| {
                    bent[a][0].mul_add(moves[0][b], bent[a][1] * moves[1][b]) * hard
                };
                Grip {
                    force: q * -chord,
                    deflection: end,
                    slope: [[entry(0, 0), entry(0, 1)], [entry(1, 0), entry(1, 1)]],
                }
            }
        }
    }
}

/// −(chord · 1 − share · u uᵀ).
#[inline(always)]
fn radial<T: Scalar>(chord: T, share: T, u: Vec2<T>) -> [[T; 2]; 2] {
    let mixed = share * u.x * u.y;
    [
        [(share * u.x).mul_add(u.x, -chord), mixed],
        [mixed, (share * u.y).mul_add(u.y, -chord)],
    ]
}

/// One contact along one line, under a load and a slip velocity that are given: state z, input s,
/// output f, N.
#[derive(Clone, Copy, Debug)]
pub struct Contact<T> {
    /// The law.
    pub tire: Tire<T>,
    /// Normal load, N.
    pub load: T,
    /// Rolling speed |r φ̇|, m/s.
    pub rolling: T,
}

impl<T: Scalar> Dynamics<T> for Contact<T> {
    fn sizes(&self) -> Sizes {
        Sizes {
            state: 1,
            input: 1,
            output: 1,
            mode: 0,
            guards: 0,
        }
    }

    fn derivative(&self, x: &[T], u: &[T], _mode: &[T], dx: &mut [T]) {
        let (slip, deflection) = (vec2(u[0], T::zero()), vec2(x[0], T::zero()));
        dx[0] = self.tire.rate(slip, deflection, self.rolling).x;
    }

    fn output(&self, x: &[T], u: &[T], _mode: &[T], y: &mut [T]) {
        let (slip, deflection) = (vec2(u[0], T::zero()), vec2(x[0], T::zero()));
        y[0] = self.load * self.tire.force(slip, deflection, self.rolling).x;
    }

    fn decide(&self, _x: &[T], _u: &[T], _mode: &mut [T]) {}
    fn settle(&self, _x: &mut [T], _u: &[T], _mode: &mut [T]) {}
    fn guards(&self, _x: &[T], _u: &[T], _mode: &[T], _g: &mut [T]) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    fn onset(slip: f64, speed_min: f64) -> Onset<f64> {
        Onset { slip, speed_min }
    }

    fn laws() -> [Tire<f64>; 8] {
        let friction = Friction {
            kinetic: 0.6,
            breakaway: 0.9,
            stribeck: 0.2,
        };
        let slip = |curve| Tire::Slip {
            curve,
            relaxation: 0.03,
            damping: 0.01,
        };
        [
            Tire::Coulomb {
                friction,
                rounding: 0.05,
            },
            Tire::Lugre {
                friction,
                stiffness: 300.0,
                damping: 1.5,
                viscous: 0.01,
            },
            slip(Curve::Brush {
                friction: 0.8,
                stiffness: 15.0,
            }),
            slip(Curve::Magic {
                friction: 0.9,
                stiffness: 20.0,
                shape: 1.4,
                curvature: -0.5,
            }),
            slip(Curve::Linear {
                friction: 0.8,
                stiffness: 12.0,
            }),
            Tire::Coulomb {
                friction: Friction::plain(0.7),
                rounding: 0.1,
            },
            Tire::Cubic {
                arcs: Arcs {
                    breakaway: 0.8,
                    kinetic: 0.4,
                    peak: onset(0.0, 0.1),
                    sliding: onset(0.0, 0.6),
                },
            },
            Tire::Cubic {
                arcs: Arcs {
                    breakaway: 0.9,
                    kinetic: 0.6,
                    peak: onset(0.1, 0.02),
                    sliding: onset(0.5, 0.1),
                },
            },
        ]
    }

    /// The slope that Newton's method uses is the derivative of the force.
    #[test]
    fn peer_slopes_against_differences() {
        for tire in laws() {
            for (slip, start, rolling) in [
                (vec2(0.02, -0.01), vec2(1e-3, 2e-3), 0.3),
                (vec2(0.7, 0.4), vec2(2e-3, -1e-3), 0.1),
                (vec2(-0.3, 0.1), vec2(0.0, 1e-4), 2.0),
            ] {
                let step = 3e-4;
                let grip = tire.respond(slip, start, rolling, step);
                for k in 0..2 {
                    let shift = 1e-6;
                    let by = if k == 0 {
                        vec2(shift, 0.0)
                    } else {
                        vec2(0.0, shift)
                    };
                    let up = tire.respond(slip + by, start, rolling, step).force;
                    let down = tire.respond(slip - by, start, rolling, step).force;
                    let difference = (up - down) * (0.5 / shift);
                    // Central differences of a force near 1 with a curvature of up to some 1e3.
                    let scale = 1e-5 * (1.0 + difference.x.abs() + difference.y.abs());
                    assert!((grip.slope[0][k] - difference.x).abs() < scale, "{tire:?}");
                    assert!((grip.slope[1][k] - difference.y).abs() < scale, "{tire:?}");
                }
            }
        }
    }

    /// A short implicit step is the explicit law at its end.
    #[test]
    fn invariant_short_steps_are_instants() {
        for tire in laws() {
            let (slip, start) = (vec2(0.2, -0.1), vec2(1e-3, 2e-3));
            let grip = tire.respond(slip, start, 0.5, 1e-9);
            let instant = tire.force(slip, grip.deflection, 0.5);
            let off = grip.force - instant;
            // Rounding of (z − z₀)/h, 1e-19/1e-9, through a stiffness of up to 1e3.
            assert!(off.x.abs() + off.y.abs() < 1e-6, "{tire:?} {off:?}");
        }
    }

    /// In steady rolling a relaxed tire is its curve at s/|r φ̇|; a locked wheel slides with all its
    /// friction.
    #[test]
    fn closed_form_steady_slip() {
        let curve = Curve::Brush {
            friction: 0.8,
            stiffness: 15.0,
        };
        let tire = Tire::Slip {
            curve,
            relaxation: 0.03,
            damping: 0.01,
        };
        let settle = |slip: Vec2<f64>, rolling| {
            let mut z = Vec2::zero();
            for _ in 0..2000 {
                z = tire.respond(slip, z, rolling, 1e-2).deflection;
            }
            tire.force(slip, z, rolling)
        };
        let slip = vec2(0.06, -0.02);
        let expected = curve.force(slip * (1.0 / 0.9));
        let found = settle(slip, 0.9);
        // A few roundings of numbers near 1.
        assert!((found.x - expected.x).abs() + (found.y - expected.y).abs() < 1e-14);
        let locked = settle(vec2(3.0, 4.0), 0.0);
        assert!((locked.x + 0.48).abs() + (locked.y + 0.64).abs() < 1e-14);
    }

    /// No law gives energy: the steady force never has a part along the slip.
    #[test]
    fn invariant_friction_takes_energy() {
        for tire in laws() {
            for k in 0..1000 {
                let angle = 0.37 * f64::from(k);
                let (sin, cos) = Scalar::sin_cos(angle);
                let slip = vec2(cos, sin) * (1e-4 * f64::from(k + 1) * f64::from(k + 1));
                let force = match tire {
                    Tire::Coulomb { .. } | Tire::Cubic { .. } => {
                        tire.force(slip, Vec2::zero(), 0.5)
                    }
                    _ => {
                        let (w, _) = tire.decay(length(slip), 0.5);
                        tire.force(slip, slip * (1.0 / w), 0.5)
                    }
                };
                assert!(force.dot(slip) < 0.0, "{tire:?} {slip:?}");
                let bound = tire.friction(slip) + 0.01 * length(slip);
                assert!(length(force) < bound * (1.0 + 1e-12), "{tire:?}");
            }
        }
    }
}
