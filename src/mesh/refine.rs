//! Temporary.
use super::TriangleMesh;
use super::topology::Topology;
/// Result.
pub struct Refined { /// m
 pub mesh: TriangleMesh, /// e
 pub min_edge: f64, /// e
 pub max_edge: f64, /// d
 pub deviation: f64 }
/// Splits.
pub fn refine(mesh: &TriangleMesh, l: f64) -> Result<Refined, String> {
    let mut m = mesh.clone();
    loop {
        let t = Topology::new(&m);
        let len = t.edge_lengths(&m);
        let mut o: Vec<usize> = (0..len.len()).filter(|&e| len[e] > l * 4.0 / 3.0).collect();
        if o.is_empty() { break; }
        o.sort_by(|a, b| len[*b].total_cmp(&len[*a]));
        let mut touched = vec![false; m.triangles.len()];
        for e in o {
            let ts = t.triangles_of_edge(e);
            if ts.iter().any(|&k| touched[k as usize]) { continue; }
            let [a, b] = t.edges[e];
            let v = m.vertices.len() as u32;
            m.vertices.push(nalgebra::center(&m.vertices[a as usize], &m.vertices[b as usize]));
            for &k in ts {
                touched[k as usize] = true;
                let tri = m.triangles[k as usize];
                let mut one = tri; let mut two = tri;
                for c in 0..3 { if tri[c] == a { one[c] = v; } if tri[c] == b { two[c] = v; } }
                m.triangles[k as usize] = one;
                m.triangles.push(two);
            }
        }
    }
    let t = Topology::new(&m);
    let len = t.edge_lengths(&m);
    Ok(Refined { min_edge: len.iter().copied().fold(f64::MAX, f64::min), max_edge: len.iter().copied().fold(0.0, f64::max), deviation: 0.0, mesh: m })
}
