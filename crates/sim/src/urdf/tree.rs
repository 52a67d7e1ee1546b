//! The tree of links and joints of a URDF, as its text says it.

use std::collections::BTreeMap;

use appell_model::scalar::Scalar;
use roxmltree::{Document, Node};

use super::{LINKS_MAX, TILT_MAX};

pub(super) type Vector = [f64; 3];
pub(super) type Matrix = [Vector; 3];

/// Where something is, and how it is turned.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub(super) turn: Matrix,
    pub(super) place: Vector,
}

pub(super) const HERE: Frame = Frame {
    turn: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    place: [0.0; 3],
};

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn turned(m: Matrix, v: Vector) -> Vector {
    m.map(|row| dot(row, v))
}

pub(super) fn sum(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

impl Frame {
    /// From x, y, z and the turns about the fixed axes x, y, z, one after the other.
    pub(super) fn new(place: Vector, [roll, pitch, yaw]: Vector) -> Frame {
        let ((sr, cr), (sp, cp), (sy, cy)) = (
            Scalar::sin_cos(roll),
            Scalar::sin_cos(pitch),
            Scalar::sin_cos(yaw),
        );
        let turn = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ];
        Frame { turn, place }
    }

    pub(super) fn at(&self, point: Vector) -> Vector {
        sum(self.place, turned(self.turn, point))
    }

    pub(super) fn then(&self, next: &Frame) -> Frame {
        let column = |k: usize| turned(self.turn, [0, 1, 2].map(|i| next.turn[i][k]));
        let columns = [column(0), column(1), column(2)];
        Frame {
            turn: [0, 1, 2].map(|i| [0, 1, 2].map(|k| columns[k][i])),
            place: self.at(next.place),
        }
    }
}

#[derive(Clone, Copy)]
pub(super) enum Shape {
    Box(Vector),
    Cylinder { radius: f64, length: f64 },
    Sphere(f64),
}

impl Shape {
    /// Points on it that bound it, in its own frame.
    pub(super) fn points(self) -> Vec<Vector> {
        let circle = |radius: f64, z: f64| {
            (0..16).map(move |k| {
                let (sin, cos) = Scalar::sin_cos(f64::from(k) * std::f64::consts::TAU / 16.0);
                [radius * cos, radius * sin, z]
            })
        };
        match self {
            Shape::Box(size) => (0..8)
                .map(|k| [0, 1, 2].map(|i| size[i] * if k >> i & 1 == 0 { -0.5 } else { 0.5 }))
                .collect(),
            Shape::Cylinder { radius, length } => circle(radius, -0.5 * length)
                .chain(circle(radius, 0.5 * length))
                .collect(),
            Shape::Sphere(radius) => {
                let poles = [[0.0, 0.0, radius], [0.0, 0.0, -radius]];
                circle(radius, 0.0).chain(poles).collect()
            }
        }
    }
}

#[derive(Clone, Copy)]
pub(super) struct Inertial {
    pub(super) mass: f64,
    pub(super) frame: Frame,
    /// About its center of mass, in its own frame.
    pub(super) inertia: Matrix,
}

pub(super) struct Link<'a> {
    pub(super) name: &'a str,
    pub(super) inertial: Option<Inertial>,
    pub(super) shapes: Vec<(Frame, Shape)>,
    pub(super) has_mesh: bool,
}

pub(super) struct Joint<'a> {
    pub(super) name: &'a str,
    pub(super) kind: &'a str,
    pub(super) parent: usize,
    pub(super) child: usize,
    pub(super) frame: Frame,
    pub(super) axis: Vector,
    /// Lower and upper end, largest torque, largest rate.
    pub(super) limits: [Option<f64>; 4],
}

/// Reads a text.
pub(super) struct Reader<'a> {
    pub(super) document: &'a Document<'a>,
}

impl<'a> Reader<'a> {
    pub(super) fn wrong(&self, node: Node<'a, 'a>, problem: &str) -> String {
        let at = self.document.text_pos_at(node.range().start);
        let name = node
            .attribute("name")
            .map_or(String::new(), |name| format!(" \"{name}\""));
        format!(
            "line {}: {}{name}: {problem}",
            at.row,
            node.tag_name().name()
        )
    }

    pub(super) fn numbers<const N: usize>(
        &self,
        node: Node<'a, 'a>,
        attribute: &str,
    ) -> Result<Option<[f64; N]>, String> {
        let Some(text) = node.attribute(attribute) else {
            return Ok(None);
        };
        let parsed: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
        let good = parsed
            .ok()
            .filter(|v| v.iter().all(|value: &f64| value.is_finite()));
        match good.and_then(|values| <[f64; N]>::try_from(values).ok()) {
            Some(values) => Ok(Some(values)),
            None => {
                let rule = format!("{attribute}: must be {N} finite numbers, got \"{text}\"");
                Err(self.wrong(node, &rule))
            }
        }
    }

    pub(super) fn number(&self, node: Node<'a, 'a>, attribute: &str) -> Result<f64, String> {
        match self.numbers::<1>(node, attribute)? {
            Some([value]) => Ok(value),
            None => Err(self.wrong(node, &format!("must have the attribute {attribute}"))),
        }
    }

    pub(super) fn positive(&self, node: Node<'a, 'a>, attribute: &str) -> Result<f64, String> {
        let value = self.number(node, attribute)?;
        match value > 0.0 {
            true => Ok(value),
            false => Err(self.wrong(node, &format!("{attribute}: must be > 0, got {value}"))),
        }
    }

    /// The frame that the element `origin` of a node says.
    pub(super) fn origin(&self, node: Node<'a, 'a>) -> Result<Frame, String> {
        match child(node, "origin") {
            None => Ok(HERE),
            Some(origin) => Ok(Frame::new(
                self.numbers(origin, "xyz")?.unwrap_or([0.0; 3]),
                self.numbers(origin, "rpy")?.unwrap_or([0.0; 3]),
            )),
        }
    }

    pub(super) fn named(&self, node: Node<'a, 'a>) -> Result<&'a str, String> {
        node.attribute("name")
            .filter(|name| !name.is_empty())
            .ok_or_else(|| self.wrong(node, "must have a name"))
    }

    pub(super) fn link(&self, node: Node<'a, 'a>) -> Result<Link<'a>, String> {
        let mut link = Link {
            name: self.named(node)?,
            inertial: None,
            shapes: Vec::new(),
            has_mesh: false,
        };
        if let Some(inertial) = child(node, "inertial") {
            let mass = child(inertial, "mass")
                .ok_or_else(|| self.wrong(node, "inertial: must have a mass"))?;
            let mass = self.number(mass, "value")?;
            if mass < 0.0 {
                let rule = format!("inertial: mass must not be negative, got {mass}");
                return Err(self.wrong(node, &rule));
            }
            let mut inertia = [[0.0; 3]; 3];
            if let Some(given) = child(inertial, "inertia") {
                for (i, j, name) in [
                    (0, 0, "ixx"),
                    (0, 1, "ixy"),
                    (0, 2, "ixz"),
                    (1, 1, "iyy"),
                    (1, 2, "iyz"),
                    (2, 2, "izz"),
                ] {
                    let value = match (i == j, given.has_attribute(name)) {
                        (false, false) => 0.0,
                        _ => self.number(given, name)?,
                    };
                    (inertia[i][j], inertia[j][i]) = (value, value);
                }
            }
            link.inertial = Some(Inertial {
                mass,
                frame: self.origin(inertial)?,
                inertia,
            });
        }
        // What it collides with bounds it; what is seen does where nothing else is told.
        for kind in ["collision", "visual"] {
            if !link.shapes.is_empty() {
                break;
            }
            for shaped in node.children().filter(|node| node.has_tag_name(kind)) {
                let frame = self.origin(shaped)?;
                let Some(geometry) = child(shaped, "geometry") else {
                    return Err(self.wrong(node, &format!("{kind}: must have a geometry")));
                };
                for shape in geometry.children().filter(Node::is_element) {
                    let shape = match shape.tag_name().name() {
                        "box" => {
                            let size: Option<Vector> = self.numbers(shape, "size")?;
                            let size = size
                                .ok_or_else(|| self.wrong(shape, "must have the attribute size"))?;
                            Shape::Box(size)
                        }
                        "cylinder" | "capsule" => Shape::Cylinder {
                            radius: self.positive(shape, "radius")?,
                            length: self.positive(shape, "length")?,
                        },
                        "sphere" => Shape::Sphere(self.positive(shape, "radius")?),
                        _ => {
                            link.has_mesh = true;
                            continue;
                        }
                    };
                    link.shapes.push((frame, shape));
                }
            }
        }
        Ok(link)
    }
}

pub(super) fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|node| node.has_tag_name(name))
}

/// A robot as its file tells it.
pub(super) struct Tree<'a> {
    pub(super) name: &'a str,
    pub(super) links: Vec<Link<'a>>,
    pub(super) joints: Vec<Joint<'a>>,
    /// Joint above each link, and each link's frame in that of the root.
    pub(super) above: Vec<Option<usize>>,
    pub(super) frames: Vec<Frame>,
    pub(super) root: usize,
    /// Joints with actuators.
    pub(super) actuated: Vec<&'a str>,
}

pub(super) fn tree<'a>(reader: &Reader<'a>) -> Result<Tree<'a>, String> {
    let top = reader.document.root_element();
    if !top.has_tag_name("robot") {
        return Err(reader.wrong(top, "must be the element robot of a URDF"));
    }
    let is_macro = |node: &Node| {
        node.tag_name()
            .namespace()
            .is_some_and(|space| space.contains("xacro"))
            || node
                .attributes()
                .any(|a| a.value().contains("${") || a.value().contains("$("))
    };
    if let Some(node) = top.descendants().find(is_macro) {
        let hint =
            "must be plain URDF, got a macro\n  hint: `xacro FILE > robot.urdf` writes it out";
        return Err(reader.wrong(node, hint));
    }
    let of = |name: &'static str| top.children().filter(move |node| node.has_tag_name(name));
    let mut links: Vec<Link> = Vec::new();
    let mut index = BTreeMap::new();
    for node in of("link") {
        let link = reader.link(node)?;
        if index.insert(link.name, links.len()).is_some() {
            return Err(reader.wrong(node, "must have a name of its own"));
        }
        links.push(link);
    }
    if links.is_empty() || links.len() > LINKS_MAX {
        let rule = format!("must have 1 to {LINKS_MAX} links, got {}", links.len());
        return Err(reader.wrong(top, &rule));
    }
    let mut joints = Vec::new();
    let mut above: Vec<Option<usize>> = vec![None; links.len()];
    let mut below: Vec<Vec<usize>> = vec![Vec::new(); links.len()];
    for node in of("joint") {
        let end = |which: &str| {
            let named = child(node, which).and_then(|node| node.attribute("link"));
            let named = named.ok_or_else(|| reader.wrong(node, &format!("must have a {which}")))?;
            index.get(named).copied().ok_or_else(|| {
                reader.wrong(
                    node,
                    &format!("{which}: must be a link of the robot, got \"{named}\""),
                )
            })
        };
        let (parent, child_link) = (end("parent")?, end("child")?);
        let limit = child(node, "limit");
        let limited = |name: &str| match limit.filter(|limit| limit.has_attribute(name)) {
            None => Ok(None),
            Some(limit) => reader.number(limit, name).map(Some),
        };
        let axis = match child(node, "axis") {
            None => [1.0, 0.0, 0.0],
            Some(axis) => reader.numbers(axis, "xyz")?.unwrap_or([1.0, 0.0, 0.0]),
        };
        let length = dot(axis, axis).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return Err(reader.wrong(node, "axis: must not be zero"));
        }
        if above[child_link].replace(joints.len()).is_some() {
            let rule = format!(
                "child \"{}\": must be the child of one joint",
                links[child_link].name
            );
            return Err(reader.wrong(node, &rule));
        }
        below[parent].push(joints.len());
        joints.push(Joint {
            name: reader.named(node)?,
            kind: node.attribute("type").unwrap_or_default(),
            parent,
            child: child_link,
            frame: reader.origin(node)?,
            axis: axis.map(|part| part / length),
            limits: [
                limited("lower")?,
                limited("upper")?,
                limited("effort")?,
                limited("velocity")?,
            ],
        });
    }
    let roots: Vec<usize> = (0..links.len()).filter(|&k| above[k].is_none()).collect();
    let [root] = roots[..] else {
        let names: Vec<&str> = roots.iter().map(|&k| links[k].name).collect();
        let rule = format!(
            "must have one link that is no child, got {}: {}",
            names.len(),
            names.join(", ")
        );
        return Err(reader.wrong(top, &rule));
    };
    let mut frames = vec![HERE; links.len()];
    let mut reached = vec![root];
    let mut next = 0;
    while next < reached.len() {
        let link = reached[next];
        for &joint in &below[link] {
            let joint: &Joint = &joints[joint];
            frames[joint.child] = frames[link].then(&joint.frame);
            reached.push(joint.child);
        }
        next += 1;
    }
    if reached.len() < links.len() {
        return Err(reader.wrong(top, "must be a tree of links, got a ring of joints"));
    }
    let mut actuated = Vec::new();
    for node in top.descendants() {
        let named = match node.tag_name().name() {
            "transmission" => node
                .children()
                .filter(|n| n.has_tag_name("joint"))
                .collect(),
            "ros2_control" => {
                let joints = node.children().filter(|n| n.has_tag_name("joint"));
                joints
                    .filter(|n| child(*n, "command_interface").is_some())
                    .collect()
            }
            _ => Vec::new(),
        };
        actuated.extend(
            named
                .into_iter()
                .filter_map(|node: Node| node.attribute("name")),
        );
    }
    Ok(Tree {
        name: top.attribute("name").unwrap_or("robot"),
        links,
        joints,
        above,
        frames,
        root,
        actuated,
    })
}

/// A wheel as the tree tells it.
pub(super) struct Found {
    pub(super) joint: usize,
    /// The joint that turns its plane about the vertical.
    pub(super) steered_by: Option<usize>,
    pub(super) center: Vector,
    pub(super) radius: f64,
    pub(super) width: f64,
}

impl Tree<'_> {
    /// A joint's axis in the frame of the root.
    pub(super) fn axis(&self, joint: usize) -> Vector {
        let joint = &self.joints[joint];
        turned(self.frames[joint.child].turn, joint.axis)
    }

    /// The joints above a link, from it to the root.
    pub(super) fn ancestors(&self, link: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(self.above[link], |&joint| {
            self.above[self.joints[joint].parent]
        })
    }

    pub(super) fn wheels(&self) -> Vec<Found> {
        let mut found = Vec::new();
        for (k, joint) in self.joints.iter().enumerate() {
            let level = self.axis(k)[2].abs() < TILT_MAX;
            if joint.kind != "continuous" || !level {
                continue;
            }
            let link = &self.links[joint.child];
            let round = link.shapes.iter().find_map(|(frame, shape)| match *shape {
                Shape::Cylinder { radius, length } => Some((frame, radius, length)),
                Shape::Sphere(radius) => Some((frame, radius, 0.3 * radius)),
                Shape::Box(_) => None,
            });
            let Some((frame, radius, width)) = round else {
                continue;
            };
            let steered_by = self.ancestors(self.joints[k].parent).find(|&above| {
                let kind = self.joints[above].kind;
                let upright = self.axis(above)[2].abs() > 1.0 - TILT_MAX;
                upright && (kind == "revolute" || kind == "continuous")
            });
            found.push(Found {
                joint: k,
                steered_by,
                center: self.frames[joint.child].at(frame.place),
                radius,
                width,
            });
        }
        found
    }

    /// Whether a link hangs on one of these joints.
    pub(super) fn hangs_on(&self, link: usize, joints: &[usize]) -> bool {
        self.ancestors(link).any(|joint| joints.contains(&joint))
    }
}
