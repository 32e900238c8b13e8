//! The storeys of `ARCHITECTURE.md`: a room imports only from the storeys below its own.
//! Also: where words may stand, and that the faults of the mutation check still have their places.

use std::fs;
use std::path::{Path, PathBuf};

const STOREYS: &[(&str, u32)] = &[
    ("math", 0),
    ("pages", 0),
    ("tally", 0),
    ("color", 1),
    ("sample", 1),
    ("geometry", 2),
    ("image", 2),
    ("photon", 2),
    ("texture", 3),
    ("accel", 3),
    ("bsdf", 3),
    ("light", 4),
    ("camera", 4),
    ("film", 4),
    ("scene", 5),
    ("shoot", 6),
    ("gather", 6),
    ("integrator", 7),
    ("bench", 8),
    ("render", 8),
    ("report", 9),
    ("verify", 9),
    ("cli", 10),
    ("main", 11),
];

/// Rooms of one storey that may use a neighbour, as the plan of the house says.
const NEIGHBOURS: [(&str, &str); 1] = [("bsdf", "texture")];

/// Rooms that a room must not know although they stand below it.
const FORBIDDEN: [(&str, &str); 2] = [("scene", "photon"), ("photon", "image")];

fn storey(room: &str) -> Option<u32> {
    STOREYS.iter().find(|(name, _)| *name == room).map(|(_, s)| *s)
}

fn sources(dir: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).expect("src/ can be read") {
        let path = entry.expect("src/ can be read").path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Each source file with its room and its text, test modules and comments left out.
fn rooms() -> Vec<(PathBuf, String, String)> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    files
        .into_iter()
        .filter_map(|file| {
            let relative = file.strip_prefix(&src).expect("below src/");
            let room = relative.components().next()?.as_os_str().to_str()?.trim_end_matches(".rs").to_owned();
            let text = fs::read_to_string(&file).expect("sources are UTF-8");
            let text = text.split("#[cfg(test)]").next().unwrap_or_default();
            let code = text.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
            Some((relative.to_owned(), room, code))
        })
        .collect()
}

#[test]
fn rooms_import_downward_only() {
    let mut wrong = Vec::new();
    for (file, room, code) in rooms() {
        if room == "lib" {
            continue;
        }
        let Some(own) = storey(&room) else {
            wrong.push(format!("{}: the room {room} has no storey", file.display()));
            continue;
        };
        for part in code.split("crate::").skip(1) {
            let used: String = part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            if used == room {
                continue;
            }
            let allowed = match storey(&used) {
                Some(s) => s < own || NEIGHBOURS.contains(&(room.as_str(), used.as_str())),
                None => true,
            };
            if !allowed || FORBIDDEN.contains(&(room.as_str(), used.as_str())) {
                wrong.push(format!("{} imports crate::{used}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn only_the_command_line_prints_or_exits() {
    for (file, room, code) in rooms() {
        if storey(&room).is_none_or(|s| s >= 8) {
            continue;
        }
        for word in ["println!", "print!(", "eprint", "std::env::var", "process::exit", "Instant::now", "SystemTime"] {
            assert!(!code.contains(word), "{} uses {word}", file.display());
        }
    }
}

#[test]
fn unsafe_stands_in_few_files() {
    for (file, room, code) in rooms() {
        let has = code.split(|c: char| !c.is_alphanumeric() && c != '_').any(|w| w == "unsafe");
        let name = file.to_string_lossy();
        let kernel =
            ["accel", "photon"].contains(&room.as_str()) && ["simd", "x86"].iter().any(|part| name.contains(part));
        let mapping = file == Path::new("scene/mesh_io/mapped.rs");
        assert!(!has || kernel || mapping, "{name} has unsafe code");
    }
}

#[test]
fn only_accel_names_the_sys_crate() {
    for (file, _, code) in rooms() {
        assert!(!code.contains("embree4_sys") || file == Path::new("accel/embree.rs"), "{}", file.display());
    }
}

/// The faults that `tests/mutations.py` plants: each still has its one place, and cases to catch it that exist and are told
/// of in `tests/mutations.md`.
#[test]
fn every_fault_of_the_mutation_check_has_its_place() {
    let read = |name: &str| {
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    };
    let faults: serde_json::Value = serde_json::from_str(&read("tests/mutations.json")).unwrap();
    let (faults, table) = (faults.as_array().unwrap(), read("tests/mutations.md"));
    let known: Vec<&str> = caustica::verify::names().iter().map(|n| n.0).collect();
    assert_eq!(faults.len(), 16);
    for (number, fault) in (1..).zip(faults) {
        let text = |key: &str| fault[key].as_str().unwrap();
        let (name, file) = (text("fault"), text("file"));
        assert_eq!(read(file).matches(text("old")).count(), 1, "{file}: the place of the fault {name:?} has changed");
        assert!(text("new").contains(&format!("fault({number})")), "{name}");
        let line = table.lines().find(|l| l.starts_with(&format!("| {name} | `{file}`"))).unwrap_or_default();
        let cases: Vec<&str> = fault["cases"].as_array().unwrap().iter().map(|c| c.as_str().unwrap()).collect();
        assert!(!cases.is_empty() && cases.iter().all(|c| known.contains(c)), "{name}: {cases:?}");
        assert!(cases.iter().all(|c| line.contains(&format!("`{c}`"))), "{name} in tests/mutations.md: {line}");
    }
}
