use super::*;

#[test]
fn measured_now() {
    let mut kept = Kept::default();
    let picture = |k: usize| -> Vec<u8> {
        (0..900usize)
            .flat_map(move |y| {
                (0..1440usize).flat_map(move |x| {
                    let d = ((x as f64 - 720.0 - k as f64).powi(2) + (y as f64 - 450.0).powi(2)).sqrt();
                    if d < 300.0 {
                        let s = (250.0 - d * 0.6) as u8;
                        [s, s / 2, ((x + k) % 97) as u8]
                    } else {
                        [245, 246, 248]
                    }
                })
            })
            .collect()
    };
    let pictures: Vec<_> = (0..10).map(|k| picture(3 * k)).collect();
    let t = Instant::now();
    for k in 0..125 {
        kept.add([1440, 900], &pictures[k % 10], Duration::from_millis(80 * k as u64));
    }
    println!("kept: {:?} a picture, {} bytes each", t.elapsed() / 125, kept.bytes() / 125);
    for (name, format) in [("gif", Format::Gif), ("png", Format::Apng)] {
        let mut bytes = Vec::new();
        let t = Instant::now();
        match format {
            Format::Gif => write_film_as_gif(&kept, &mut bytes).unwrap(),
            Format::Apng => write_film_as_apng(&kept, &mut bytes).unwrap(),
        };
        println!("{name}: 125 pictures in {:?}, {} bytes", t.elapsed(), bytes.len());
    }
}
