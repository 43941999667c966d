//! Results of searches that are kept, and shapes that the file gives.

use std::fs;
use std::path::Path;

use host_gen::design::outcome::{Advice, Refusal};
use host_gen::design::{Cache, Design, DesignError, Effort, Search, Study};
use tempfile::TempDir;

use crate::common::{edited, parse, rough, set, study};

/// The frame under the direct law, whose search is short.
fn text() -> String {
    edited(&[])
}

fn search(folder: &Path, study: &Study) -> Result<Design, DesignError> {
    search_with(Effort::Full, folder, study)
}

fn search_with(effort: Effort, folder: &Path, study: &Study) -> Result<Design, DesignError> {
    let cache = Cache::at(folder);
    let search = Search {
        effort,
        cache: Some(&cache),
        ..Search::FULL
    };
    search.design(study)
}

fn entries(folder: &TempDir) -> Vec<std::path::PathBuf> {
    let entries = fs::read_dir(folder.path()).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

/// What is kept gives the table that a search gives, for every law that has one. How long the
/// search of the modal law was makes no difference; that a given shaping is verified on perturbed
/// machines as a found one is, is [`shapes_of_the_file_are_verified`].
#[test]
fn what_is_kept_is_what_is_found() {
    for (effort, edits) in [
        (Effort::Full, &[][..]),
        (
            Effort::Rough,
            &[
                ("control.law", "\"modal\""),
                ("control.minimise", "\"rms\""),
            ][..],
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let study = study(&edited(edits));
        let fresh = search_with(effort, folder.path(), &study).unwrap();
        assert_eq!(entries(&folder).len(), 1);
        let kept = search_with(effort, folder.path(), &study).unwrap();
        assert_eq!(kept.table, fresh.table);
        assert_eq!(
            serde_json::to_string(&kept).unwrap(),
            serde_json::to_string(&fresh).unwrap()
        );
    }
}

/// An entry that is not whole, is not of this machine, or claims what does not hold, is
/// not used: the search is made, and its result kept.
#[test]
fn damaged_and_foreign_entries_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(&text());
    let expected = search(folder.path(), &study).unwrap().table;
    let entry = entries(&folder).remove(0);
    let good = fs::read_to_string(&entry).unwrap();
    // Of another machine, whole, under this one's name.
    let other = tempfile::tempdir().unwrap();
    let heavier = crate::common::study(&edited(&[("bodies.lens.mass", "900.0")]));
    search(other.path(), &heavier).unwrap();
    let foreign = fs::read_to_string(entries(&other).remove(0)).unwrap();
    assert_ne!(foreign, good);
    for bad in [
        String::new(),
        "{}".to_owned(),
        good[..good.len() / 2].to_owned(),
        good.replace("corner_hz\":", "corner_hz\":9"),
        foreign,
    ] {
        fs::write(&entry, &bad).unwrap();
        let design = search(folder.path(), &study).unwrap();
        assert!(design.table == expected, "{bad}");
        assert_eq!(fs::read_to_string(&entry).unwrap(), good);
    }
    // Where nothing can be kept, nothing fails.
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    assert!(search(&file, &study).unwrap().table == expected);
}

/// A refusal is kept with its reason and advice.
#[test]
fn refusals_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let study = study(&edited(&[("control.frequency", "0.1")]));
    let fresh = search(folder.path(), &study).unwrap_err().to_string();
    assert_eq!(entries(&folder).len(), 1);
    assert_eq!(
        search(folder.path(), &study).unwrap_err().to_string(),
        fresh
    );
}

/// Whatever changes the table changes the digest too; and what a search reads, the name of
/// its entry: two machines with one entry would share a controller.
#[test]
fn whatever_decides_the_controller_is_in_the_digest() {
    let of = |edits: &[(&str, &str)]| {
        let machine = parse(&edited(edits)).unwrap();
        (machine.digest, machine.search_inputs())
    };
    let modal = ("control.law", "\"modal\"");
    let rms = ("control.minimise", "\"rms\"");
    let band = |band| [modal, rms, ("simulation.floor_band", band)];
    // The search minimises the rms on this band.
    assert_ne!(of(&band("[1.0, 200.0]")), of(&band("[20.0, 60.0]")));
    assert_ne!(of(&band("[1.0, 200.0]")).0, of(&band("[20.0, 60.0]")).0);
    // So it does on this floor, and over this exposure.
    for (minimise, key, read) in [
        ("\"peaks\"", ("floor.spectrum", "\"vc-e\""), false),
        ("\"rms\"", ("floor.spectrum", "\"vc-e\""), true),
        ("\"rms\"", ("simulation.floor_rms", "2e-5"), true),
        ("\"rms\"", ("performance.exposure", "0.5"), false),
        ("\"average\"", ("performance.exposure", "0.5"), true),
        ("\"deviation\"", ("performance.exposure", "0.5"), true),
    ] {
        let minimise = ("control.minimise", minimise);
        let here = of(&[modal, ("performance.exposure", "0.1"), minimise]);
        let there = of(&[modal, ("performance.exposure", "0.1"), minimise, key]);
        assert_eq!(here.0 != there.0, read, "{minimise:?} {key:?}");
        assert!(!read || here.1 != there.1, "{minimise:?} {key:?}");
    }
    // It verifies the modal law on these machines.
    for (key, value) in [
        ("robustness.mass", "0.21"),
        ("robustness.cog", "0.021"),
        ("robustness.leg_stiffness", "0.13"),
        ("robustness.samples", "7"),
        ("robustness.seed", "77"),
        ("robustness.payload", "[\"frame\"]"),
    ] {
        let (digest, inputs) = of(&[modal]);
        let (other_digest, other_inputs) = of(&[modal, (key, value)]);
        assert_ne!(digest, other_digest, "{key}");
        assert_ne!(inputs, other_inputs, "{key}");
    }
    // What it does not read leaves table and digest as they are.
    for (key, value) in [
        ("simulation.duration", "3.0"),
        ("simulation.seed", "9"),
        ("simulation.floor_band", "[2.0, 100.0]"),
        ("robustness.samples", "1000"),
    ] {
        assert_eq!(of(&[modal]).0, of(&[modal, (key, value)]).0, "{key}");
    }
}

/// The two tables of two floor bands, one digest of which began this.
#[test]
fn floor_bands_make_two_tables_and_two_digests() {
    let table = |band| {
        let edits = [
            ("control.law", "\"modal\""),
            ("control.minimise", "\"rms\""),
            ("simulation.floor_band", band),
        ];
        let study = study(&edited(&edits));
        rough().design(&study).unwrap().table
    };
    let [a, b] = ["[1.0, 200.0]", "[20.0, 60.0]"].map(table);
    assert!(a.get().law != b.get().law);
    assert_ne!(a.get().model, b.get().model);
}

/// The shapes that `design` prints, put into the file, give the same controller without a
/// search; worse ones are refused with the loop's own reason.
#[test]
fn shapes_of_the_file_are_verified() {
    let edits = [("control.law", "\"modal\"")];
    let (study, found) = crate::common::searched(&edited(&edits));
    let found = found.as_ref().unwrap();
    let analysis =
        host_gen::analysis::controller::DesignAnalysis::new(study, found.clone()).unwrap();
    let printed = analysis.to_string();
    let shapes = printed.find("[[control.shapes]]").unwrap();
    let with = |shapes: &str| {
        let mut table: toml::Table = edited(&edits).parse().unwrap();
        let shapes: toml::Table = shapes.parse().unwrap();
        set(
            &mut table,
            "control.shapes",
            shapes["control"]["shapes"].clone(),
        );
        crate::common::study(&table.to_string())
    };
    struct Counting(std::sync::atomic::AtomicUsize);
    impl host_gen::progress::Progress for Counting {
        fn advance(&self) {
            self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        }
    }
    let trials = Counting(0.into());
    let search = Search {
        progress: &trials,
        ..Search::FULL
    };
    let design = search.design(&with(&printed[shapes..])).unwrap();
    assert_eq!(trials.0.into_inner(), 0);
    let (ms, expected) = (design.peak_sensitivity.value, found.peak_sensitivity.value);
    assert!((ms / expected - 1.0).abs() < 1e-4, "{ms} {expected}");
    let [drawn, expected] = [&design, found].map(|design| design.drawn.unwrap());
    assert_eq!(
        (drawn.samples, drawn.stable),
        (expected.samples, expected.stable)
    );
    let (ms, expected) = (drawn.peak_sensitivity, expected.peak_sensitivity);
    assert!((ms / expected - 1.0).abs() < 1e-3, "{ms} {expected}");
    for (band, expected) in design.bands.iter().zip(&found.bands) {
        // Six digits of every corner.
        assert!((band.sampled_db - expected.sampled_db).abs() < 1e-3);
    }

    // Every pole ten times as fast: far above the bound.
    let mut fast: toml::Table = printed[shapes..].parse().unwrap();
    for shape in fast["control"]["shapes"].as_array_mut().unwrap() {
        for section in shape["sections"].as_array_mut().unwrap() {
            let hz = &mut section["poles"]["hz"];
            let faster = (10.0 * hz.as_float().unwrap()).min(9e3);
            *hz = toml::Value::Float(faster);
        }
    }
    let refused = Search::FULL.design(&with(&fast.to_string())).unwrap_err();
    assert!(
        matches!(
            refused,
            DesignError::Unreachable {
                refusal: Refusal {
                    advice: Advice::OtherShapes,
                    ..
                },
                ..
            }
        ),
        "{refused}"
    );
}
