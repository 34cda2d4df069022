//! The examples of the library run, and their assertions hold.

use std::error::Error;

#[path = "../examples/body_and_bone.rs"]
mod body_and_bone;
#[path = "../examples/fibres_of_a_muscle.rs"]
mod fibres_of_a_muscle;
#[path = "../examples/morph_two_bodies.rs"]
mod morph_two_bodies;
#[path = "../examples/own_constraint.rs"]
mod own_constraint;
#[path = "../examples/quasi_static_pose.rs"]
mod quasi_static_pose;
#[path = "../examples/read_and_repair.rs"]
mod read_and_repair;

#[test]
fn own_constraint_runs() {
    own_constraint::main();
}

#[test]
fn body_and_bone_runs() -> Result<(), Box<dyn Error>> {
    body_and_bone::main()
}

#[test]
fn quasi_static_pose_runs() -> Result<(), Box<dyn Error>> {
    quasi_static_pose::main()
}

#[test]
fn read_and_repair_runs() -> Result<(), Box<dyn Error>> {
    read_and_repair::main()
}

#[test]
fn fibres_of_a_muscle_runs() -> Result<(), Box<dyn Error>> {
    fibres_of_a_muscle::main()
}

#[test]
fn morph_two_bodies_runs() -> Result<(), Box<dyn Error>> {
    morph_two_bodies::main()
}
