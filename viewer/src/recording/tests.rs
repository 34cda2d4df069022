//! Films and pictures keep their content; errors of writing are reported.

use super::*;
use pliant::testing::Scratch;

/// A picture with a bar at position `k`.
fn picture(width: usize, height: usize, k: usize) -> Vec<u8> {
    let colour = |x: usize| {
        if x / 4 == k {
            [200, 40, 30]
        } else {
            [250, 250, 250]
        }
    };
    (0..height)
        .flat_map(|_| (0..width).flat_map(colour))
        .collect()
}

/// Pushes pictures, each as soon as there is room for it.
fn push_all(recorder: &mut Recorder, pictures: &[(Vec<u8>, u64)], [width, height]: [usize; 2]) {
    for (k, (rgb, ms)) in pictures.iter().enumerate() {
        assert_eq!(
            recorder
                .push_at(width, height, rgb, Duration::from_millis(*ms))
                .expect("fits"),
            Pushed::Taken
        );
        let end = Instant::now() + Duration::from_secs(60);
        while recorder.pictures() <= k && Instant::now() < end {
            std::thread::yield_now();
        }
    }
}

fn pngs(path: &Path) -> Vec<(Vec<u8>, u16)> {
    let file = io::BufReader::new(File::open(path).expect("a file"));
    let mut reader = png::Decoder::new(file).read_info().expect("a picture");
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let count = reader
        .info()
        .animation_control()
        .expect("an animation")
        .num_frames;
    let mut canvas = vec![0; 3 * width * height];
    let mut all = Vec::new();
    for _ in 0..count {
        let mut part = vec![0; 3 * width * height];
        let shape = reader.next_frame(&mut part).expect("a frame");
        let at = *reader.info().frame_control().expect("its place");
        let line = 3 * shape.width as usize;
        for (y, row) in part
            .chunks_exact(line)
            .take(shape.height as usize)
            .enumerate()
        {
            let begin = 3 * ((at.y_offset as usize + y) * width + at.x_offset as usize);
            canvas[begin..begin + line].copy_from_slice(row);
        }
        all.push((canvas.clone(), at.delay_num));
    }
    all
}

#[test]
fn an_animated_png_has_the_pictures_and_their_times() {
    let folder = Scratch::folder();
    let path = folder.join("a.apng");
    let mut recorder = Recorder::start(&path).expect("starts");
    let pictures: Vec<_> = [0, 80, 170, 250, 480]
        .into_iter()
        .enumerate()
        .map(|(k, ms)| (picture(40, 20, k), ms))
        .collect();
    push_all(&mut recorder, &pictures, [40, 20]);
    assert!(!path.exists(), "it is not there before it is whole");
    let recorded = recorder.stop().wait().expect("written");
    assert_eq!(
        recorded,
        Recorded {
            path: path.clone(),
            pictures: 5,
            dropped: 0,
            is_full: false
        }
    );
    let found = pngs(&path);
    assert_eq!(
        found.iter().map(|(_, ms)| *ms).collect::<Vec<_>>(),
        [80, 90, 80, 230, 80]
    );
    assert!(found.iter().zip(&pictures).all(|((a, _), (b, _))| a == b));
    assert_ne!(found[0].0, pictures[1].0, "control: another picture");
    assert_eq!(
        fs::read_dir(&*folder).expect("a folder").count(),
        1,
        "nothing else is left"
    );
}

#[test]
fn a_gif_has_the_pictures_and_their_times() {
    let folder = Scratch::folder();
    let path = folder.join("a.gif");
    let mut recorder = Recorder::start(&path).expect("starts");
    let pictures: Vec<_> = [0, 100, 300]
        .into_iter()
        .enumerate()
        .map(|(k, ms)| (picture(40, 20, k), ms))
        .collect();
    push_all(&mut recorder, &pictures, [40, 20]);
    recorder.stop().wait().expect("written");
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::Indexed);
    let mut decoder = options
        .read_info(File::open(&path).expect("a file"))
        .expect("a GIF");
    let colours = decoder.global_palette().expect("a palette").to_vec();
    let (mut canvas, mut delays, mut k) = (vec![0; 40 * 20 * 3], Vec::new(), 0);
    while let Some(frame) = decoder.read_next_frame().expect("a frame") {
        for (n, index) in frame
            .buffer
            .iter()
            .enumerate()
            .filter(|(_, index)| frame.transparent != Some(**index))
        {
            let (x, y) = (n % usize::from(frame.width), n / usize::from(frame.width));
            let at = 3 * ((usize::from(frame.top) + y) * 40 + usize::from(frame.left) + x);
            canvas[at..at + 3].copy_from_slice(&colours[3 * usize::from(*index)..][..3]);
        }
        assert_eq!(canvas, pictures[k].0, "frame {k}");
        assert_ne!(canvas, pictures[(k + 1) % 3].0, "control");
        delays.push(frame.delay);
        k += 1;
    }
    assert_eq!(delays, [10, 20, 8]);
}

#[test]
fn pictures_come_twelve_and_a_half_times_a_second() {
    let folder = Scratch::folder();
    let mut recorder = Recorder::start(&folder.join("a.gif")).expect("starts");
    let small = picture(4, 4, 0);
    let mut taken = Vec::new();
    // A window of 60 pictures a second for eight seconds.
    for k in 0..480u32 {
        let at = Duration::from_secs_f64(f64::from(k) / 60.0);
        match recorder.push_at(4, 4, &small, at).expect("fits") {
            Pushed::Early => {}
            _ => taken.push(at.as_secs_f64()),
        }
    }
    assert_eq!(taken.len(), 100);
    assert!(
        taken
            .windows(2)
            .all(|pair| (pair[1] - pair[0] - 0.08).abs() < 1.0 / 60.0 + 1e-9),
        "{taken:?}"
    );
    // Late pictures are not repeated.
    let mut late = Recorder::start(&folder.join("b.gif")).expect("starts");
    let early = [0, 1000, 1010, 1030].map(|ms| {
        late.push_at(4, 4, &small, Duration::from_millis(ms))
            .expect("fits")
            == Pushed::Early
    });
    assert_eq!(early, [false, false, true, true]);
    assert!(!late.is_due(), "the next is due in a second and a bit");
}

#[test]
fn wide_pictures_are_made_smaller_and_other_sizes_fit() {
    let folder = Scratch::folder();
    let path = folder.join("a.png");
    let mut recorder = Recorder::start(&path).expect("starts");
    push_all(&mut recorder, &[(vec![90; 3 * 1440 * 900], 0)], [1440, 900]);
    assert_eq!(
        recorder
            .push_at(300, 400, &vec![10; 3 * 300 * 400], Duration::from_secs(1))
            .expect("fits"),
        Pushed::Taken
    );
    assert_eq!(recorder.stop().wait().expect("written").pictures, 2);
    let found = pngs(&path);
    assert_eq!(found[0].0.len(), 3 * 720 * 450);
    assert!(found[0].0.iter().all(|c| *c == 90) && found[1].0.iter().all(|c| *c == 10));
}

#[test]
fn it_ends_by_itself_and_says_so() {
    let folder = Scratch::folder();
    let path = folder.join("a.png");
    let mut recorder = Recorder::start_with(&path, 3).expect("starts");
    let pictures: Vec<_> = (0..3).map(|k| (picture(16, 4, k), 80 * k as u64)).collect();
    push_all(&mut recorder, &pictures[..2], [16, 4]);
    assert!(!recorder.is_full(), "control");
    push_all_from(&mut recorder, &pictures[2]);
    let end = Instant::now() + Duration::from_secs(60);
    while !recorder.is_full() && Instant::now() < end {
        std::thread::yield_now();
    }
    let later = recorder
        .push_at(16, 4, &pictures[0].0, Duration::from_secs(9))
        .expect("fits");
    assert_eq!((later, recorder.dropped()), (Pushed::Full, 0));
    let mut recording = recorder.stop();
    while recording.poll().is_none() && Instant::now() < end {
        std::thread::yield_now();
    }
    let recorded = recording
        .poll()
        .expect("in time")
        .as_ref()
        .expect("written");
    assert_eq!((recorded.pictures, recorded.is_full), (3, true));
    assert_eq!(pngs(&path).len(), 3);
}

fn push_all_from(recorder: &mut Recorder, (rgb, ms): &(Vec<u8>, u64)) {
    assert_eq!(
        recorder
            .push_at(16, 4, rgb, Duration::from_millis(*ms))
            .expect("fits"),
        Pushed::Taken
    );
}

#[test]
fn a_window_never_waits_and_what_is_dropped_is_counted() {
    let folder = Scratch::folder();
    let mut recorder = Recorder::start(&folder.join("a.png")).expect("starts");
    // The thread takes longer for each picture than its transfer.
    let large: Vec<u8> = (0..3 * 1600 * 1200u32)
        .map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let pushed: Vec<Pushed> = (0..40)
        .map(|k| {
            recorder
                .push_at(1600, 1200, &large, Duration::from_millis(100 * k))
                .expect("fits")
        })
        .collect();
    let dropped = pushed.iter().filter(|p| **p == Pushed::Dropped).count();
    assert!(dropped > 0 && dropped == recorder.dropped(), "{pushed:?}");
    let recorded = recorder.stop().wait().expect("written");
    assert_eq!(
        (recorded.pictures + recorded.dropped, recorded.dropped),
        (40, dropped)
    );
}

#[test]
fn what_cannot_be_recorded_is_reported() {
    let folder = Scratch::folder();
    let start = |name: &str| {
        Recorder::start(&folder.join(name))
            .map(|_| ())
            .map_err(|e| e.to_string())
    };
    for name in ["a.mp4", "a", "gif"] {
        assert!(
            start(name).is_err_and(|e| e.contains("name it .gif, .png or .apng")),
            "{name}"
        );
    }
    assert_eq!(start("A.GIF"), Ok(()));
    assert!(
        start("no/such/a.gif")
            .is_err_and(|e| e.contains("a.gif` cannot be written") && e.contains("another folder"))
    );
    fs::write(folder.join("b.gif"), "mine").expect("a file");
    assert!(start("b.gif").is_err_and(|e| e.contains("is there already")));
    assert_eq!(fs::read(folder.join("b.gif")).expect("a file"), b"mine");
    let mut recorder = Recorder::start(&folder.join("c.gif")).expect("starts");
    for (width, height, bytes) in [(2, 2, 11), (0, 2, 0), (usize::MAX, 2, 6)] {
        let wrong = recorder.push(width, height, &vec![0; bytes]);
        assert!(
            matches!(wrong, Err(RecordingError::Size { .. })),
            "{width} x {height}"
        );
    }
    let nothing = recorder.stop().wait().expect_err("nothing was recorded");
    assert!(
        nothing.to_string().contains("nothing was recorded, so"),
        "{nothing}"
    );
    assert!(!folder.join("c.gif").exists());
    // A folder that disappears during the recording.
    let gone = folder.join("gone");
    fs::create_dir(&gone).expect("a folder");
    let mut recorder = Recorder::start(&gone.join("d.gif")).expect("starts");
    push_all(&mut recorder, &[(picture(16, 4, 0), 0)], [16, 4]);
    fs::remove_dir_all(&gone).expect("an empty folder");
    let error = recorder.stop().wait().expect_err("there is no folder");
    assert!(
        matches!(error, RecordingError::Write { .. }) && error.to_string().contains("d.gif"),
        "{error}"
    );
}

/// A device that is always full.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_reported() {
    let folder = Scratch::folder();
    let path = folder.join("a.gif");
    let mut recorder = Recorder::start(&path).expect("starts");
    push_all(&mut recorder, &[(picture(16, 4, 0), 0)], [16, 4]);
    // The temporary file of the film is a link to the device.
    std::os::unix::fs::symlink("/dev/full", folder.join("a.gif.part")).expect("a link");
    let error = recorder
        .stop()
        .wait()
        .expect_err("there is no room")
        .to_string();
    assert!(
        error.contains("a.gif` cannot be written: No space left"),
        "{error}"
    );
    assert!(!path.exists());
}

#[test]
fn a_picture_is_saved_whole_under_the_next_free_name() {
    let folder = Scratch::folder();
    let next = |ending: &str| free_name(&folder, "hip: a", ending).expect("a name");
    let path = next("png");
    assert_eq!(path, folder.join("hip__a-0001.png"));
    let rgb = picture(16, 4, 2);
    save_png(&path, 16, 4, &rgb).expect("written");
    let mut reader = png::Decoder::new(io::BufReader::new(File::open(&path).expect("a file")))
        .read_info()
        .expect("a PNG");
    let mut found = vec![0; rgb.len()];
    reader.next_frame(&mut found).expect("a picture");
    assert_eq!(found, rgb);
    assert_ne!(found, picture(16, 4, 1), "control");
    assert_eq!(next("png"), folder.join("hip__a-0002.png"));
    assert_eq!(
        next("gif"),
        folder.join("hip__a-0001.gif"),
        "of another ending"
    );
    for other in [
        "hip__a-0041.png",
        "hip__a-x.png",
        "hip__a-.png",
        "hip__ab-0099.png",
        "hip__a-0050.png.part",
    ] {
        fs::write(folder.join(other), "").expect("a file");
    }
    assert_eq!(next("png"), folder.join("hip__a-0042.png"));
    assert!(free_name(&folder.join("no"), "a", "png").is_err());
    assert!(matches!(
        save_png(&path, 16, 5, &rgb),
        Err(RecordingError::Size { .. })
    ));
    assert!(matches!(
        save_png(&folder.join("no/a.png"), 16, 4, &rgb),
        Err(RecordingError::Write { .. })
    ));
}
