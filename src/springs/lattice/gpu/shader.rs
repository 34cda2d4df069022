//! The kernels of a lattice in WGSL, made for its size and its springs.
//!
//! Numbers are displacements from rest, not positions. A spring at rest has the vector `h` and the length `l0`; its
//! ends are displaced by `w` against each other. What it is longer than at rest, `l - l0`, is
//! `(2 h + w) . w / (l + l0)`: no difference of two lengths, so that single precision tells small strains as finely as
//! great ones, and a lattice at rest has no forces at all. The last step of each point is a number of its own: a
//! difference of two places would round it as coarsely as they are.

use std::fmt::Write as _;

use super::super::stability::{Direction, directions};
use super::super::{LatticeSettings, LatticeShape};

/// Points of a workgroup.
pub(super) const GROUP: u32 = 256;

/// Most workgroups along a dimension of a dispatch.
pub(super) const MOST_GROUPS: u32 = 65_535;

/// What all kernels share. Places and steps are runs of x, y and z.
const COMMON: &str = "
@group(0) @binding(0) var<storage, read> now: array<f32>;
@group(0) @binding(1) var<storage, read_write> next: array<f32>;
@group(0) @binding(2) var<storage, read_write> steps: array<f32>;
@group(0) @binding(3) var<storage, read> pinned: array<u32>;
@group(0) @binding(4) var<storage, read_write> force_x: array<f32>;
@group(0) @binding(5) var<storage, read_write> force_y: array<f32>;
@group(0) @binding(6) var<storage, read_write> force_z: array<f32>;
@group(0) @binding(7) var<storage, read_write> parts: array<vec4f>;

fn number(id: vec3u) -> u32 { return id.x + id.y * ACROSS; }
fn at(p: u32) -> vec3f { return vec3f(now[p], now[p + COUNT], now[p + 2u * COUNT]); }
fn last(p: u32) -> vec3f { return vec3f(steps[p], steps[p + COUNT], steps[p + 2u * COUNT]); }
fn is_pinned(p: u32) -> bool { return ((pinned[p >> 5u] >> (p & 31u)) & 1u) == 1u; }
fn beside(p: u32, by: i32) -> u32 { return u32(i32(p) + by); }

// Force on the first end of a spring, and half of its energy: the other half is that of its other end.
fn pull(w: vec3f, h: vec3f, rest: f32, stiffness: f32) -> vec4f {
    let d = h + w;
    let length = sqrt(dot(d, d));
    let longer = dot(h + d, w) / (length + rest);
    // Ends that coincide have no direction.
    let by = select(0.0, stiffness * longer / length, length > 0.0);
    return vec4f(d * by, 0.25 * stiffness * longer * longer);
}

fn move_by(p: u32, force: vec3f) {
    if (is_pinned(p)) { return; }
    let step = last(p) * KEPT + force * GAIN;
    let to = at(p) + step;
    for (var c = 0u; c < 3u; c++) {
        steps[p + c * COUNT] = step[c];
        next[p + c * COUNT] = to[c];
    }
}
";

/// The method `single`: forces and motion in one pass.
const SINGLE: &str = "
@compute @workgroup_size(GROUP)
fn single(@builtin(global_invocation_id) id: vec3u) {
    let p = number(id);
    if (p >= COUNT) { return; }
    move_by(p, pulled(p).xyz);
}
";

/// The method `point`: each point gathers its forces, then each moves.
const POINT: &str = "
@compute @workgroup_size(GROUP)
fn gather(@builtin(global_invocation_id) id: vec3u) {
    let p = number(id);
    if (p >= COUNT) { return; }
    let force = pulled(p);
    force_x[p] = force.x;
    force_y[p] = force.y;
    force_z[p] = force.z;
}

@compute @workgroup_size(GROUP)
fn integrate(@builtin(global_invocation_id) id: vec3u) {
    let p = number(id);
    if (p >= COUNT) { return; }
    move_by(p, vec3f(force_x[p], force_y[p], force_z[p]));
}
";

/// The method `edge`: each spring stores its force, then each point takes those of its springs and moves. Two passes
/// in place of atomic sums: the order of the sum is always the same.
const EDGE: &str = "
@compute @workgroup_size(GROUP)
fn scatter(@builtin(global_invocation_id) id: vec3u) {
    let p = number(id);
    if (p >= COUNT) { return; }
    let force = along(p, id.z);
    let to = p + id.z * COUNT;
    force_x[to] = force.x;
    force_y[to] = force.y;
    force_z[to] = force.z;
}

@compute @workgroup_size(GROUP)
fn collect(@builtin(global_invocation_id) id: vec3u) {
    let p = number(id);
    if (p >= COUNT) { return; }
    move_by(p, collected(p));
}
";

/// Measures: greatest square of a force and of a move, and sums of squared speeds and energies, of each workgroup.
const MEASURE: &str = "
var<workgroup> found: array<vec4f, GROUP>;

@compute @workgroup_size(GROUP)
fn measure(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    let p = number(id);
    var own = vec4f();
    if (p < COUNT) {
        let pulls = pulled(p);
        own.w = pulls.w;
        if (!is_pinned(p)) {
            let step = last(p);
            let half_speed = step * PER_DT;
            let speed = half_speed + (pulls.xyz - half_speed * DAMPING) * HALF_GAIN;
            own = vec4f(dot(pulls.xyz, pulls.xyz), dot(step, step), dot(speed, speed), pulls.w);
        }
    }
    found[thread] = own;
    for (var half = GROUP / 2u; half > 0u; half >>= 1u) {
        workgroupBarrier();
        if (thread < half) {
            let a = found[thread];
            let b = found[thread + half];
            found[thread] = vec4f(max(a.xy, b.xy), a.zw + b.zw);
        }
    }
    if (thread == 0u) { parts[group.x + group.y * (ACROSS / GROUP)] = found[0]; }
}
";

/// Threads along x of a dispatch over `count` threads, and the workgroups along x and y.
pub(super) fn groups(count: u32) -> [u32; 2] {
    let all = count.div_ceil(GROUP);
    let across = all.min(MOST_GROUPS);
    [across, all.div_ceil(across)]
}

/// All kernels. `kept` and `gain` are the factors of a step.
pub(super) fn source(
    shape: &LatticeShape,
    settings: &LatticeSettings,
    [dt, damping]: [f64; 2],
) -> String {
    let [nx, ny, nz] = shape.points;
    let (count, mass) = (shape.count(), settings.mass);
    let all = directions(shape, settings);
    let [across, _] = groups(count as u32);
    let mut text = format!(
        "const GROUP = {GROUP}u;\nconst ACROSS = {}u;\nconst COUNT = {count}u;\nconst NX = {nx}u;\nconst NY = {ny}u;\nconst NZ = {nz}u;\n",
        across * GROUP
    );
    for (name, value) in [
        ("KEPT", 1.0 - damping * dt / mass),
        ("GAIN", dt * dt / mass),
        ("PER_DT", 1.0 / dt),
        ("DAMPING", damping),
        ("HALF_GAIN", 0.5 * dt / mass),
    ] {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "const {name} = {};", literal(value));
    }
    text.push_str(COMMON);
    text.push_str(&of_points(&all, shape));
    text.push_str(&of_springs(&all, shape));
    for kernels in [SINGLE, POINT, EDGE, MEASURE] {
        text.push_str(kernels);
    }
    text
}

/// A number of single precision.
fn literal(value: f64) -> String {
    format!("{:e}f", value as f32)
}

/// The distance of the numbers of two points.
fn offset(step: [i32; 3], shape: &LatticeShape) -> i64 {
    let [nx, ny, _] = shape.points.map(|n| n as i64);
    let [i, j, k] = step.map(i64::from);
    i + nx * (j + ny * k)
}

/// The condition that a neighbour exists.
fn exists(step: [i32; 3]) -> String {
    let each = ["x", "y", "z"].into_iter().zip(step);
    let all = each.filter_map(|(c, by)| match by {
        1 => Some(format!("c.{c} + 1u < N{}", c.to_uppercase())),
        -1 => Some(format!("c.{c} > 0u")),
        _ => None,
    });
    all.collect::<Vec<_>>().join(" && ")
}

/// The rest vector of a direction, its length, and the stiffness.
fn spring(direction: &Direction, shape: &LatticeShape, sign: f64) -> String {
    let h = [0, 1, 2].map(|c| {
        let by = f64::from(direction.step[c]) * shape.spacing[c];
        // No negative zero.
        literal(if by == 0.0 { 0.0 } else { sign * by })
    });
    format!(
        "vec3f({}), {}, {}",
        h.join(", "),
        literal(direction.rest),
        literal(direction.stiffness)
    )
}

/// `pulled`: the force on a point and its part of the energy, from all its springs.
fn of_points(all: &[Direction], shape: &LatticeShape) -> String {
    let mut text = String::from(
        "fn place(p: u32) -> vec3u { return vec3u(p % NX, p / NX % NY, p / (NX * NY)); }\n\
         fn pulled(p: u32) -> vec4f {\n    let c = place(p);\n    let u = at(p);\n    var sum = vec4f();\n",
    );
    for direction in all {
        for sign in [1, -1] {
            let step = direction.step.map(|s| sign * s);
            let _ = writeln!(
                text,
                "    if ({}) {{ sum += pull(at(beside(p, {})) - u, {}); }}",
                exists(step),
                offset(step, shape),
                spring(direction, shape, f64::from(sign))
            );
        }
    }
    text.push_str("    return sum;\n}\n");
    text
}

/// `along`: the force on the first end of the spring of a direction; `collected`: the sum of those of a point.
fn of_springs(all: &[Direction], shape: &LatticeShape) -> String {
    let mut text = String::from(
        "fn along(p: u32, direction: u32) -> vec3f {\n    let c = place(p);\n    let u = at(p);\n    switch (direction) {\n",
    );
    let mut sums = String::from(
        "fn stored(at: u32) -> vec3f { return vec3f(force_x[at], force_y[at], force_z[at]); }\n\
         fn collected(p: u32) -> vec3f {\n    let c = place(p);\n    var sum = vec3f();\n",
    );
    for (k, direction) in all.iter().enumerate() {
        let (by, back) = (offset(direction.step, shape), direction.step.map(|s| -s));
        let _ = writeln!(
            text,
            "        case {k}u: {{ if ({}) {{ return pull(at(beside(p, {by})) - u, {}).xyz; }} }}",
            exists(direction.step),
            spring(direction, shape, 1.0)
        );
        let _ = writeln!(
            sums,
            "    sum += stored(p + {k}u * COUNT);\n    if ({}) {{ sum -= stored(beside(p, {}) + {k}u * COUNT); }}",
            exists(back),
            -by
        );
    }
    text.push_str("        default: {}\n    }\n    return vec3f();\n}\n");
    text.push_str(&sums);
    text.push_str("    return sum;\n}\n");
    text
}
