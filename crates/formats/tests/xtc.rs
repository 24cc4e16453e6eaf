//! XTC: a file that mdtraj wrote, files of every shape there and back, after a kill, and broken at random.

use phipsi_formats::dcd::DcdReader;
use phipsi_formats::trajectory::{Frame, convert};
use phipsi_formats::xtc::{XtcReader, XtcWriter};
use std::path::PathBuf;

/// Written by mdtraj 1.11.1 (GROMACS's own compression): 40 atoms, 3 frames, 0.5 ps and 250 steps apart.
const MDTRAJ: &[u8] = include_bytes!("xtc/mdtraj.xtc");

/// The positions in it: twelve waters, and four atoms far away.
fn frame(k: i32) -> Vec<[f64; 3]> {
    let k = f64::from(k);
    let mut x = Vec::new();
    for w in 0..12 {
        let n = f64::from(w);
        let [a, b, c] = [0.31 * n + 0.001 * k, -0.17 * n, 0.05 * f64::from(w * w % 7)];
        x.extend([[a, b, c], [a + 0.096, b + 0.003 * n, c], [a - 0.024, b + 0.093, c + 0.001 * k]]);
    }
    x.extend((0..4).map(|i| [100.0 * f64::from(i) - 150.0, -3.5, 0.125 + k]));
    x
}

/// A folder that is removed again.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("phipsi-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Scratch(path)
    }
    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn frames(path: &std::path::Path) -> Vec<Frame> {
    let mut reader = XtcReader::open(path).unwrap();
    std::iter::from_fn(|| reader.next_frame().unwrap()).collect()
}

/// Half a unit of the last digit, and the rounding of f32.
fn assert_near(a: &[[f64; 3]], b: &[[f64; 3]]) {
    assert_eq!(a.len(), b.len());
    for (x, y) in a.iter().flatten().zip(b.iter().flatten()) {
        assert!((x - y).abs() <= 0.500_01e-3 + 2.0 * f64::from(f32::EPSILON) * y.abs(), "{x} {y}");
    }
}

#[test]
fn a_file_of_mdtraj_is_read() {
    let scratch = Scratch::new("mdtraj");
    let path = scratch.file("a.xtc");
    std::fs::write(&path, MDTRAJ).unwrap();
    let read = frames(&path);
    assert_eq!(read.len(), 3);
    for (k, found) in (0..).zip(&read) {
        assert_eq!((found.step, found.time_ps), (250 * k, Some(0.5 * f64::from(k))));
        // Numbers of three decimals come back as they were.
        for (x, y) in found.positions.iter().flatten().zip(frame(k).iter().flatten()) {
            assert!((x - y).abs() < 1e-4 + 2e-7 * y.abs(), "{x} {y}");
        }
    }
}

/// Numbers of a random walk: uniform in ±1.
struct Walk(u64);

impl Walk {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
    fn positions(&mut self, atoms: usize, step: f64, jump: f64) -> Vec<[f64; 3]> {
        let mut x = [0.0; 3];
        let mut place = |i: usize| {
            let size = if i % 7 == 6 { jump } else { step };
            x = x.map(|x| x + size * self.next());
            x
        };
        (0..atoms).map(&mut place).collect()
    }
}

#[test]
fn every_shape_comes_back() {
    let scratch = Scratch::new("shapes");
    let path = scratch.file("a.xtc");
    let mut walk = Walk(1);
    for atoms in [1, 2, 9, 10, 11, 12, 33, 304, 1000] {
        for (step, jump) in
            [(0.0, 0.0), (0.1, 0.1), (0.001, 5.0), (0.02, 0.02), (30.0, 3000.0), (1e5, 1e5 / 7.0)]
        {
            let shapes: Vec<_> =
                (0..3).map(|_| walk.positions(atoms, step / (1.0 + atoms as f64 / 100.0), jump)).collect();
            let mut writer = XtcWriter::create(&path, atoms).unwrap();
            (0..).zip(&shapes).for_each(|(k, x)| writer.write(k, f64::from(k), x).unwrap());
            let read = frames(&path);
            assert_eq!(read.len(), 3, "{atoms} atoms, steps of {step}");
            read.iter().zip(&shapes).for_each(|(a, b)| assert_near(&a.positions, b));
        }
    }
}

#[test]
fn molecules_take_a_third_of_single_precision() {
    let scratch = Scratch::new("size");
    let path = scratch.file("a.xtc");
    let x = Walk(3).positions(1000, 0.1, 0.1);
    XtcWriter::create(&path, 1000).unwrap().write(0, 0.0, &x).unwrap();
    let size = std::fs::metadata(&path).unwrap().len();
    assert!(size < 12 * 1000 * 45 / 100, "{size} bytes");
}

#[test]
fn a_half_written_frame_is_left_out_and_cut_off() {
    let scratch = Scratch::new("kill");
    let path = scratch.file("a.xtc");
    for cut in [MDTRAJ.len() - 1, MDTRAJ.len() - 40, MDTRAJ.len() * 2 / 3 + 20] {
        std::fs::write(&path, &MDTRAJ[..cut]).unwrap();
        assert_eq!(frames(&path).len(), 2);
        XtcWriter::append(&path, 40).unwrap().write(500, 1.0, &frame(2)).unwrap();
        let read = frames(&path);
        assert_eq!(read.len(), 3);
        assert_near(&read[2].positions, &frame(2));
    }
    assert!(XtcWriter::append(&path, 41).unwrap_err().found.contains("40 atoms"));
}

#[test]
fn broken_files_are_refused_and_nothing_panics() {
    let scratch = Scratch::new("broken");
    let path = scratch.file("a.xtc");
    let mut walk = Walk(7);
    let mut index = |n: usize| ((walk.next() + 1.0) / 2.0 * n as f64) as usize;
    for _ in 0..600 {
        let mut bytes = MDTRAJ.to_vec();
        for _ in 0..1 + index(4) {
            let at = index(bytes.len());
            bytes[at] = [0, 1, 0x7f, 0x80, 0xff, index(256) as u8][index(6)];
        }
        bytes.truncate(bytes.len() - [0, 0, 1, 17][index(4)]);
        std::fs::write(&path, &bytes).unwrap();
        let mut reader = XtcReader::open(&path).unwrap();
        while let Ok(Some(found)) = reader.next_frame() {
            assert!(!found.positions.is_empty());
        }
    }
    std::fs::write(&path, b"CORD of another format, and longer than a header of 56 bytes").unwrap();
    let error = XtcReader::open(&path).unwrap().next_frame().unwrap_err();
    assert!(error.to_string().contains("required: 1995"), "{error}");
}

#[test]
fn positions_that_do_not_fit_are_refused() {
    let scratch = Scratch::new("refused");
    let mut writer = XtcWriter::create(scratch.file("a.xtc"), 2).unwrap();
    for bad in [f64::NAN, f64::INFINITY, 2.2e6, -1e300] {
        assert!(writer.write(0, 0.0, &[[0.0; 3], [0.0, bad, 0.0]]).unwrap_err().found.contains("atom 1"));
    }
    assert!(writer.write(0, 0.0, &[[0.0; 3]]).unwrap_err().required.contains("2 atoms"));
    assert!(XtcWriter::create(scratch.file("b.xtc"), 0).is_err());
}

/// A PDB file of the atoms.
fn names(atoms: usize) -> String {
    let line = |i: usize| {
        format!(
            "HETATM{:5}  O   HOH A{:4}    {:8.3}{:8.3}{:8.3}  1.00  0.00           O\n",
            i + 1,
            i + 1,
            0.0,
            0.0,
            0.0
        )
    };
    (0..atoms).map(line).collect()
}

#[test]
fn formats_are_converted_into_each_other() {
    let scratch = Scratch::new("convert");
    let [xtc, dcd, pdb, again, last] =
        ["a.xtc", "b.dcd", "c.pdb", "d.dcd", "e.xtc"].map(|name| scratch.file(name));
    std::fs::write(&xtc, MDTRAJ).unwrap();
    assert_eq!(convert(&xtc, None, &dcd).unwrap().frames, 3);
    let mut reader = DcdReader::open(&dcd).unwrap();
    for k in 0..3 {
        let found = reader.next_frame().unwrap().unwrap();
        assert_eq!(found.step, 250 * k);
        assert!((found.time_ps.unwrap() - 0.5 * f64::from(k)).abs() < 1e-6);
        assert_near(&found.positions, &frame(k));
    }
    assert!(reader.next_frame().unwrap().is_none());
    // PDB needs names, and has 0.001 Å.
    assert!(convert(&dcd, None, &pdb).unwrap_err().required.contains("names"));
    let near = scratch.file("near.xtc");
    let inside: Vec<[f64; 3]> = frame(0).into_iter().take(36).collect();
    XtcWriter::create(&near, 36).unwrap().write(0, 0.0, &inside).unwrap();
    let with_names = scratch.file("names.pdb");
    std::fs::write(&with_names, names(36)).unwrap();
    assert_eq!(convert(&near, Some(&with_names), &pdb).unwrap().atoms, 36);
    assert_eq!(convert(&pdb, None, &again).unwrap().frames, 1);
    assert_eq!(convert(&again, None, &last).unwrap().frames, 1);
    assert_near(&frames(&last)[0].positions, &inside);
    assert!(convert(&pdb, None, &again).unwrap_err().required.contains("does not exist"));
    assert!(convert(&xtc, None, &scratch.file("f.trr")).unwrap_err().required.contains(".xtc"));
    std::fs::write(scratch.file("few.pdb"), names(3)).unwrap();
    let error = convert(&xtc, Some(&scratch.file("few.pdb")), &scratch.file("g.pdb")).unwrap_err();
    assert!(error.found == "3 atoms", "{error}");
}
