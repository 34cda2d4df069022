use pliant::simulation::Simulation;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let scene = pliant::scene::builtin::load(&a[1], &a[2..]).unwrap_or_else(|e| panic!("{e:?}"));
    let t = std::time::Instant::now();
    let mut sim = Simulation::new(scene).unwrap();
    for n in &sim.notes {
        println!("{n}");
    }
    for b in &sim.bodies {
        println!(
            "{} n={} attached={} untangled {:?} edge {:.2} mm length {:.3}",
            b.name,
            b.rest.vertices.len(),
            b.attached.len(),
            b.untangled,
            b.edge_length * 1e3,
            b.length
        );
    }
    for l in &sim.plan.left_out {
        println!("left out: {} {} {}", l.muscle, l.effect, l.why);
    }
    println!("build {:?}", t.elapsed());
    let every: usize = std::env::var("EVERY").ok().and_then(|e| e.parse().ok()).unwrap_or(20);
    for f in 0..=sim.scene.frames {
        if f > 0 {
            sim.step_frame();
        }
        if f % every == 0 || f < 3 {
            for m in sim.measure() {
                println!(
                    "{:3} {:12} vol {:+.1e} str {:.3}/{:.2} pen {:.3}mm in {} bonein {} touch {} pinch {} res {:.4}mm ke {:.1e} dist {:.2}mm conv {} t {:.1}s",
                    f,
                    m.muscle,
                    m.volume_error,
                    m.edge_stretch_rms,
                    m.edge_stretch_max,
                    m.penetration_m * 1e3,
                    m.vertices_inside_bones,
                    m.bone_vertices_inside,
                    m.vertices_touching,
                    m.vertices_pinched,
                    m.residual_m * 1e3,
                    m.kinetic_energy_j,
                    m.distance_from_start_rms_m * 1e3,
                    m.converged,
                    t.elapsed().as_secs_f64()
                );
            }
        }
    }
    for b in &sim.bodies {
        println!(
            "{:?} {:?} cuts {} stopped {:?}",
            b.system.clock,
            b.system.contacts.as_ref().map(|c| c.counts(&b.system.particles.position)),
            b.system.speed_cuts,
            b.stopped
        );
        let mut o = String::new();
        for v in &b.system.particles.position {
            o += &format!("v {} {} {}\n", v.x, v.y, v.z);
        }
        for t in &b.rest.triangles {
            o += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
        }
        std::fs::write(format!("/tmp/exp/{}.obj", b.name.replace(' ', "_")), o).unwrap();
    }
}
#[allow(dead_code)]
fn diagnose(sim: &Simulation) {
    for b in &sim.bodies {
        let x = &b.system.particles.position;
        let mut s: Vec<(f64, [u32; 2])> = b.edges.iter().map(|e| { let [p, q] = e.points.map(|p| x[p as usize]); (((p - q).norm() / e.rest - 1.0).abs(), e.points) }).collect();
        s.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (st, [p, q]) in s.iter().take(4) {
            let d = |v: u32| (0..sim.bones.len()).map(|k| { let c = pliant::contact::Obstacle::closest(sim.surface(k), &(sim.pose(k, sim.frame() as f64).inverse() * x[v as usize])).unwrap(); format!("{:.2}", c.distance * 1e3) }).collect::<Vec<_>>().join("/");
            let (a, c2) = (x[*p as usize], x[*q as usize]);
            let lows: Vec<String> = (0..sim.bones.len()).map(|k| { let inv = sim.pose(k, sim.frame() as f64).inverse(); let m = (0..=40).map(|t| pliant::contact::Obstacle::closest(sim.surface(k), &(inv * (a + (c2 - a) * (t as f64 / 40.0)))).unwrap().distance).fold(f64::MAX, f64::min); format!("{:.2}", m * 1e3) }).collect();
            print!("   along {}", lows.join("/"));
            let h = |v: u32| b.attached.iter().find(|a| a.0 == v).map_or("free".to_string(), |a| format!("bone{}", a.1));
            println!(" strain {st:.2} {p} {q} {} {} dist {} | {} at {:?} moved {:.1} {:.1}", h(*p), h(*q), d(*p), d(*q), x[*p as usize].coords.as_slice(), (x[*p as usize] - b.rest.vertices[*p as usize]).norm() * 1e3, (x[*q as usize] - b.rest.vertices[*q as usize]).norm() * 1e3);
        }
    }
}
