// SPDX-License-Identifier: MIT OR Apache-2.0
//! A controller as Appell sees it: through its functions.

use appell_sdk::{Now, controller};
use std::ffi::{CStr, c_char, c_void};
use std::ptr;

controller! {
    name: "tested",
    version: "1.0",
    about: "Says \"ramp\".",
    inputs: { x: "pose.x" in "m", wheel: "wheel.left.spin_rate" in "rad/s" },
    outputs: {
        forward: "command.forward" in "m/s" [-1.0, 1],
        /// Its own.
        count: "controller.count" in "",
    },
    parameters: {
        slope: -0.5 in "m/s²" [-1.0, f64::INFINITY] "how steep",
        limit: 2,
    },
    memory: { forward: f64 = 0.25, count: u64 = 0, last: Option<[f64; 2]> = None },
    start: start,
    step: step,
}

fn start(context: &str, parameters: &Parameters) -> Result<Memory, String> {
    match context.contains("here") {
        true => Ok(Memory {
            forward: parameters.limit / 8.0,
            ..Memory::default()
        }),
        false => Err(format!("cannot work in {context}")),
    }
}

fn step(
    now: &Now<Outputs>,
    inputs: &Inputs,
    parameters: &Parameters,
    memory: &mut Memory,
) -> Result<Outputs, String> {
    assert!(inputs.x >= 0.0, "behind the wall");
    if inputs.wheel.is_nan() {
        return Err(format!("no wheel at {} s", now.t));
    }
    if let Some(before) = now.before {
        memory.forward = before.forward;
    }
    memory.forward += parameters.slope * now.dt;
    memory.count += 1;
    memory.last = Some([inputs.x, inputs.wheel]);
    Ok(Outputs {
        forward: memory.forward,
        count: memory.count as f64,
    })
}

unsafe extern "C" {
    safe fn appell_abi() -> u32;
    safe fn appell_describe() -> *const c_char;
    fn appell_create(parameters: *const f64, context: *const c_char) -> *mut c_void;
    fn appell_destroy(member: *mut c_void);
    fn appell_step(m: *mut c_void, t: f64, dt: f64, inputs: *const f64, outputs: *mut f64) -> i32;
    fn appell_reason(member: *mut c_void) -> *const c_char;
    fn appell_save(member: *mut c_void, bytes: *mut u8, room: usize) -> usize;
    fn appell_restore(member: *mut c_void, bytes: *const u8, length: usize) -> i32;
    fn appell_take_over(member: *mut c_void, outputs: *const f64) -> i32;
}

/// A member as a host holds it.
struct Member(*mut c_void);

impl Member {
    fn new(context: &CStr) -> Result<Member, String> {
        // SAFETY: two parameters, and a text.
        let made = unsafe { appell_create([-0.5, 2.0].as_ptr(), context.as_ptr()) };
        match made.is_null() {
            true => Err(reason(made)),
            false => Ok(Member(made)),
        }
    }

    fn step(&mut self, inputs: [f64; 2]) -> Result<[f64; 2], String> {
        let mut outputs = [f64::NAN; 2];
        let (from, to) = (inputs.as_ptr(), outputs.as_mut_ptr());
        // SAFETY: two inputs and two outputs.
        match unsafe { appell_step(self.0, 3.0, 0.5, from, to) } {
            0 => Ok(outputs),
            _ => Err(reason(self.0)),
        }
    }

    fn save(&self) -> Vec<u8> {
        // SAFETY: the length is asked for first.
        unsafe {
            let mut bytes = vec![0; appell_save(self.0, ptr::null_mut(), 0)];
            assert_eq!(
                appell_save(self.0, bytes.as_mut_ptr(), bytes.len()),
                bytes.len()
            );
            bytes
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), String> {
        // SAFETY: as many bytes.
        match unsafe { appell_restore(self.0, bytes.as_ptr(), bytes.len()) } {
            0 => Ok(()),
            _ => Err(reason(self.0)),
        }
    }

    fn take_over(&mut self, outputs: [f64; 2]) {
        // SAFETY: two outputs.
        assert_eq!(unsafe { appell_take_over(self.0, outputs.as_ptr()) }, 0);
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        // SAFETY: made by `new`.
        unsafe { appell_destroy(self.0) }
    }
}

fn reason(member: *mut c_void) -> String {
    // SAFETY: a text that ends with zero.
    let text = unsafe { CStr::from_ptr(appell_reason(member)) };
    text.to_str().expect("UTF-8").to_owned()
}

#[test]
fn closed_form_description() {
    assert_eq!(appell_abi(), 1);
    // SAFETY: a text that ends with zero.
    let text = unsafe { CStr::from_ptr(appell_describe()) };
    let expected = concat!(
        r#"{"protocol": 1, "name": "tested", "version": "1.0", "about": "Says \"ramp\".", "#,
        r#""inputs": [{"name": "pose.x", "unit": "m"}, "#,
        r#"{"name": "wheel.left.spin_rate", "unit": "rad/s"}], "#,
        r#""outputs": [{"name": "command.forward", "unit": "m/s", "min": -1.0, "max": 1.0}, "#,
        r#"{"name": "controller.count", "unit": ""}], "#,
        r#""parameters": [{"name": "slope", "unit": "m/s²", "default": -0.5, "min": -1.0, "about": "how steep"}, "#,
        r#"{"name": "limit", "unit": "", "default": 2.0, "about": ""}]}"#,
    );
    assert_eq!(text.to_str(), Ok(expected));
    assert_eq!(Parameters::default().limit, 2.0);
}

#[test]
fn closed_form_steps() {
    let mut member = Member::new(c"here").expect("it starts");
    assert_eq!(member.step([1.0, 0.0]), Ok([0.0, 1.0]));
    assert_eq!(member.step([1.0, 0.0]), Ok([-0.25, 2.0]));
}

#[test]
fn invariant_failures_have_reasons() {
    let refused = Member::new(c"space").err();
    assert_eq!(refused.as_deref(), Some("cannot work in space"));
    let mut member = Member::new(c"here").expect("it starts");
    assert_eq!(
        member.step([1.0, f64::NAN]),
        Err("no wheel at 3 s".to_owned())
    );
    assert_eq!(
        member.step([-1.0, 0.0]),
        Err("panicked: behind the wall".to_owned())
    );
    assert_eq!(member.step([1.0, 0.0]), Ok([0.0, 1.0]));
}

#[test]
fn invariant_a_member_with_the_memory_of_another_goes_on_as_it_would() {
    let mut one = Member::new(c"here").expect("it starts");
    one.step([1.0, 0.0]).expect("it steps");
    let mut other = Member::new(c"here").expect("it starts");
    other.restore(&one.save()).expect("it is its memory");
    assert_eq!(one.step([2.0, 0.0]), other.step([2.0, 0.0]));
    let saved = one.save();
    assert_eq!(saved.len(), 1 + 8 + 8 + 1 + 16);
    for wrong in [&saved[1..], &[&saved[..], &[0]].concat(), &[]] {
        let refused = Err("these bytes are not of its memory".to_owned());
        assert_eq!(other.restore(wrong), refused);
    }
    assert_eq!(one.step([2.0, 0.0]), other.step([2.0, 0.0]));
}

#[test]
fn invariant_the_first_step_after_a_change_knows_what_was_before() {
    let mut one = Member::new(c"here").expect("it starts");
    one.take_over([0.75, 9.0]);
    // It is not forgotten by saving before that step.
    let mut other = Member::new(c"here").expect("it starts");
    other.restore(&one.save()).expect("it is its memory");
    assert_eq!(one.step([1.0, 0.0]), Ok([0.5, 1.0]));
    assert_eq!(one.step([1.0, 0.0]), Ok([0.25, 2.0]));
    assert_eq!(other.step([1.0, 0.0]), Ok([0.5, 1.0]));
}
