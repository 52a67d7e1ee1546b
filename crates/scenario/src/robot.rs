//! The robot file: body, wheels and drives. Plain data, as [`super`].

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::defaults;

/// A robot file: body, wheels and drives.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Platform {
    /// Version of this format; 1.
    pub schema: u32,
    /// Name of the robot.
    pub name: String,
    /// One or two sentences: what it is and where the numbers come from.
    #[serde(default)]
    pub description: String,
    /// Radius of the disc about the base's origin that must not touch anything, m.
    pub collision_radius: f64,
    /// Outline in the base frame, m, counter-clockwise; drawn, and bounds the plausible inertia.
    #[serde(default)]
    pub footprint: Vec<[f64; 2]>,
    /// The body without its wheels.
    pub body: Body,
    /// 1 to 12 wheels; 11 with a trailer.
    pub wheel: Vec<Wheel>,
    /// A trailer that it tows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trailer: Option<Trailer>,
}

impl Platform {
    /// The robot as TOML: a robot file.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a robot is plain data")
    }
}

/// A trailer with two wheels on one axle, on a hitch. Its signals are those of a wheel called
/// `trailer`: the hitch angle is its steering angle, its forces are those of both wheels together.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Trailer {
    /// Place of the hitch in the base frame, m.
    pub hitch: [f64; 2],
    /// Height of the hitch above the ground, m.
    pub hitch_height: f64,
    /// Distance from the hitch back to the axle, m.
    pub length: f64,
    /// Distance between the wheels, m.
    pub track: f64,
    /// Mass without the wheels, kg.
    pub mass: f64,
    /// Distance of the center of mass before the axle, m; from 0 to `length` with the hitch loaded
    /// downwards.
    pub ahead: f64,
    /// Yaw inertia about its own center of mass, kg·m², without the wheels.
    pub inertia_com: f64,
    /// Radius of the wheels, m.
    pub radius: f64,
    /// Width of the wheels, m; drawn only.
    #[serde(default = "defaults::width")]
    pub width: f64,
    /// Mass of each wheel, kg.
    #[serde(default)]
    pub wheel_mass: f64,
    /// Spin inertia of each wheel, kg·m².
    #[serde(default)]
    pub spin_inertia: f64,
    /// Losses: of each wheel, and `pivot_viscous` of the hitch.
    #[serde(default)]
    pub friction: Friction,
    /// Angle at the start, degrees: 0 straight behind.
    #[serde(default)]
    pub angle_deg: f64,
    /// Outline, m, counter-clockwise, from the middle of its axle, x to the hitch; drawn only.
    #[serde(default)]
    pub footprint: Vec<[f64; 2]>,
}

/// Name of a trailer's axle among the wheels.
pub const TRAILER: &str = "trailer";

/// The body without the wheels.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Mass, kg.
    pub mass: f64,
    /// Yaw inertia about its own center of mass, kg·m².
    pub inertia_com: f64,
    /// Center of mass in the base frame (x forward, y left, z above the ground), m.
    pub center_of_mass: [f64; 3],
    /// Inertia about the forward axis through its own center of mass, kg·m²; for a suspension.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_inertia_com: Option<f64>,
    /// Inertia about the left axis through its own center of mass, kg·m²; for a suspension.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_inertia_com: Option<f64>,
}

/// A wheel: a mount, a radius, a steering and a rim.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Wheel {
    /// Name, unique in the robot.
    pub name: String,
    /// Contact point (casters and steered wheels: pivot) in the base frame, m.
    pub mount: [f64; 2],
    /// Radius, m.
    pub radius: f64,
    /// Width, m; drawn only.
    #[serde(default = "defaults::width")]
    pub width: f64,
    /// How its plane turns about the vertical.
    #[serde(default)]
    pub steering: Steering,
    /// What its rim resists.
    #[serde(default)]
    pub rim: Rim,
    /// Mass, kg.
    #[serde(default)]
    pub mass: f64,
    /// Spin inertia about the axle, kg·m², without the rotor.
    #[serde(default)]
    pub spin_inertia: f64,
    /// Inertia about the vertical, kg·m².
    #[serde(default)]
    pub vertical_inertia: f64,
    /// Losses at the axle and the pivot.
    #[serde(default)]
    pub friction: Friction,
    /// Largest torque of its brake, N·m; the brake command is a channel of the signals controller.
    #[serde(default)]
    pub brake_torque: f64,
    /// What drives the axle; nothing if left out.
    #[serde(default)]
    pub drive: Drive,
    /// How it grips the ground at level `slip`.
    #[serde(default)]
    pub tire: Tire,
    /// The spring and damper on which it carries the body: heave, roll and pitch then are motions of
    /// their own at level `slip`. All wheels of a robot have one, or none has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suspension: Option<Suspension>,
}

/// A spring and a damper between a wheel and the body, along the body's normal. Springs are set so that the
/// robot stands level on level ground.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Suspension {
    /// Of the spring, N/m.
    pub stiffness: f64,
    /// Of the damper, N·s/m.
    pub damping: f64,
}

/// A contact law: force over normal load for a slip of the contact patch. Slip stiffness is force over
/// normal load per unit of normalised slip (a slip angle in radians, a slip ratio).
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "law", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Tire {
    /// Coulomb friction rounded off about zero slip. It creeps on a slope.
    Coulomb {
        /// Friction coefficient in sliding.
        #[serde(default = "defaults::friction")]
        friction: f64,
        /// Friction coefficient at the onset of sliding; that of sliding if left out.
        #[serde(default)]
        breakaway: Option<f64>,
        /// Slip velocity over which the one becomes the other, m/s.
        #[serde(default = "defaults::stribeck")]
        stribeck: f64,
        /// Slip velocity over which friction is rounded off, m/s.
        #[serde(default = "defaults::rounding")]
        rounding: f64,
    },
    /// The LuGre law: bristles that hold at rest.
    Lugre {
        /// Friction coefficient in sliding.
        #[serde(default = "defaults::friction")]
        friction: f64,
        /// Friction coefficient at the onset of sliding; that of sliding if left out.
        #[serde(default)]
        breakaway: Option<f64>,
        /// Slip velocity over which the one becomes the other, m/s.
        #[serde(default = "defaults::stribeck")]
        stribeck: f64,
        /// Stiffness of the bristles over normal load, 1/m.
        #[serde(default = "defaults::bristle_stiffness")]
        stiffness: f64,
        /// Damping of the bristles over normal load, s/m.
        #[serde(default = "defaults::bristle_damping")]
        damping: f64,
        /// Viscous friction over normal load, s/m.
        #[serde(default)]
        viscous: f64,
    },
    /// The brush law behind a relaxation length.
    Brush {
        /// Friction coefficient.
        #[serde(default = "defaults::friction")]
        friction: f64,
        /// Slip stiffness over normal load.
        #[serde(default = "defaults::slip_stiffness")]
        stiffness: f64,
        /// Way over which the force builds up, m.
        #[serde(default = "defaults::relaxation")]
        relaxation: f64,
        /// Time by which the deflection's rate adds to it, s: damping at rest.
        #[serde(default = "defaults::damping")]
        damping: f64,
    },
    /// Pacejka's magic formula behind a relaxation length.
    MagicFormula {
        /// Friction coefficient at the peak (D).
        #[serde(default = "defaults::friction")]
        friction: f64,
        /// Slip stiffness over normal load (B C D).
        #[serde(default = "defaults::slip_stiffness")]
        stiffness: f64,
        /// Shape factor (C), in [1, 2].
        #[serde(default = "defaults::shape")]
        shape: f64,
        /// Curvature factor (E), at most 1.
        #[serde(default)]
        curvature: f64,
        /// Way over which the force builds up, m.
        #[serde(default = "defaults::relaxation")]
        relaxation: f64,
        /// Time by which the deflection's rate adds to it, s: damping at rest.
        #[serde(default = "defaults::damping")]
        damping: f64,
    },
    /// Force in proportion to slip up to the limit of friction, behind a relaxation length.
    Linear {
        /// Friction coefficient.
        #[serde(default = "defaults::friction")]
        friction: f64,
        /// Slip stiffness over normal load (cornering stiffness).
        #[serde(default = "defaults::slip_stiffness")]
        stiffness: f64,
        /// Way over which the force builds up, m.
        #[serde(default = "defaults::relaxation")]
        relaxation: f64,
        /// Time by which the deflection's rate adds to it, s: damping at rest.
        #[serde(default = "defaults::damping")]
        damping: f64,
    },
}

impl Default for Tire {
    fn default() -> Self {
        Tire::Brush {
            friction: defaults::friction(),
            stiffness: defaults::slip_stiffness(),
            relaxation: defaults::relaxation(),
            damping: defaults::damping(),
        }
    }
}

/// How the wheel plane turns.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Steering {
    /// Fixed in the body.
    Fixed {
        /// Angle of the rolling direction against the base's x-axis, degrees.
        #[serde(default)]
        angle_deg: f64,
    },
    /// Swivels freely: a caster.
    Free {
        /// Distance from the pivot back to the contact, m.
        trail: f64,
        /// Angle at the start, degrees.
        #[serde(default)]
        angle_deg: f64,
    },
    /// Turned by a steering motor about the pivot above its contact.
    Steered {
        /// Angle at the start, degrees.
        #[serde(default)]
        angle_deg: f64,
        /// Largest angle to either side, degrees.
        angle_max_deg: f64,
        /// Largest rate of turning, rad/s.
        #[serde(default = "defaults::steering_rate")]
        rate_max: f64,
        /// Largest torque of the steering motor, N·m; unlimited if left out.
        #[serde(default)]
        torque_max: Option<f64>,
        /// Bandwidth of the loop that turns it to the wanted angle, rad/s.
        #[serde(default = "defaults::steering_bandwidth")]
        bandwidth: f64,
    },
    /// Turned by a linkage in proportion to a steered wheel.
    Linked {
        /// Name of the steered wheel.
        to: String,
        /// Its angle is this times that of the steered wheel: 1 for a synchro drive, −1 for the other
        /// end of a vehicle that steers at both.
        #[serde(default = "defaults::one")]
        ratio: f64,
    },
    /// Turned by an ideal (Ackermann) linkage so that its axle goes through the center of the turn,
    /// which a steered wheel and the axle of the fixed ones set. It has no mass, loss and drive.
    Guided {
        /// Name of the steered wheel.
        by: String,
    },
}

impl Default for Steering {
    fn default() -> Self {
        Steering::Fixed { angle_deg: 0.0 }
    }
}

/// What the rim resists.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Rim {
    /// A tire: rolls along its plane and not across.
    #[default]
    Plain,
    /// Rollers, as of mecanum (±45°) and omni wheels (0°).
    Rollers {
        /// From the rolling direction to the axis of the roller on the ground, degrees.
        angle_deg: f64,
    },
}

/// Losses of a wheel.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    /// Viscous coefficient of the axle, N·m·s/rad.
    #[serde(default)]
    pub viscous: f64,
    /// Dry friction of bearing and gear at the axle, N·m; set-valued: it holds a wheel at rest.
    #[serde(default)]
    pub dry: f64,
    /// Coefficient of rolling resistance: resisting force over normal load, with the load that the
    /// wheel carries at rest on level ground, times the cosine of the slope.
    #[serde(default)]
    pub rolling: f64,
    /// Viscous coefficient of the pivot of a caster, N·m·s/rad.
    #[serde(default)]
    pub pivot_viscous: f64,
}

/// What drives an axle.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Drive {
    /// Nothing: the wheel turns freely.
    #[default]
    None,
    /// An ideal torque source.
    Torque {
        /// Largest torque at the axle, N·m.
        torque_max: f64,
        /// Largest spin rate commanded at level `kinematic`, rad/s.
        rate_max: f64,
    },
    /// A DC motor with gearbox.
    DcMotor {
        /// Armature resistance, Ω.
        resistance: f64,
        /// Armature inductance, H; 0 for a winding without one.
        inductance: f64,
        /// Torque constant, N·m/A.
        torque_constant: f64,
        /// Back-EMF constant, V·s/rad; equal to the torque constant unless measured apart.
        #[serde(default)]
        back_emf_constant: Option<f64>,
        /// Motor turns per wheel turn.
        #[serde(default = "defaults::one")]
        gear_ratio: f64,
        /// Efficiency of the gearbox.
        #[serde(default = "defaults::one")]
        gear_efficiency: f64,
        /// Inertia of the rotor, kg·m²; adds n² of it to the spin inertia.
        #[serde(default)]
        rotor_inertia: f64,
        /// Supply voltage, V.
        voltage_max: f64,
        /// Current limit of the driver, A; none if left out.
        #[serde(default)]
        current_max: Option<f64>,
    },
}
