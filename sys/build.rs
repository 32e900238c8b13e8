//! Finds the installed Embree and makes bindings from its own headers, because the layout of its structures depends
//! on how it was configured. Without Embree or libclang the crate builds empty, with one warning.
//!
//! Environment: `EMBREE_DIR` is searched before the usual prefixes; `EMBREE_REQUIRED=1` makes a missing Embree an
//! error; `EMBREE_DISABLE=1` builds without it and says nothing.
use std::io::Read;
use std::path::{Path, PathBuf};
use std::{env, fs, panic, process};

/// Functions that the wrapper and the benches call. Types and constants they need follow by themselves.
const FUNCTIONS: &str = "rtc(NewDevice|ReleaseDevice|GetDeviceProperty|GetDeviceError|GetDeviceLastErrorMessage|\
    SetDeviceErrorFunction|SetDeviceMemoryMonitorFunction|\
    NewScene|ReleaseScene|SetSceneFlags|SetSceneBuildQuality|AttachGeometryByID|CommitScene|GetSceneBounds|\
    NewGeometry|ReleaseGeometry|CommitGeometry|SetSharedGeometryBuffer|SetGeometryBuildQuality|SetGeometryUserData|\
    SetGeometryUserPrimitiveCount|SetGeometryBoundsFunction|SetGeometryIntersectFunction|SetGeometryOccludedFunction|\
    SetGeometryInstancedScene|SetGeometryTransform|Intersect1|Intersect16|Occluded1|Occluded16)";
const CONSTANTS: &str = "RTC_(VERSION.*|MAX_INSTANCE_LEVEL_COUNT)";

/// An installed Embree.
struct Found {
    major: u32,
    /// The folder that holds `embree4/rtcore.h` or `embree3/rtcore.h`.
    include: PathBuf,
    /// The folder that holds the shared library.
    lib: PathBuf,
}

fn main() {
    println!("cargo::rustc-check-cfg=cfg(embree, embree3, embree4, embree_error_text)");
    println!("cargo::rerun-if-changed=build.rs");
    for name in ["EMBREE_DIR", "EMBREE_REQUIRED", "EMBREE_DISABLE", "LIBCLANG_PATH", "LLVM_CONFIG_PATH"] {
        println!("cargo::rerun-if-env-changed={name}");
    }
    match (is_set("EMBREE_DISABLE"), is_set("EMBREE_REQUIRED")) {
        (true, true) => fail("EMBREE_DISABLE and EMBREE_REQUIRED contradict each other; unset one of them"),
        (true, false) => return,
        _ => {}
    }
    if let Err(reason) = find().and_then(|found| bind(&found)) {
        let remedy = "on Debian: apt-get install libembree-dev libclang-dev";
        if is_set("EMBREE_REQUIRED") {
            fail(&format!("EMBREE_REQUIRED is set, but {reason}; {remedy}"));
        }
        println!("cargo::warning=building without Embree, with the Rust BVH alone: {reason}; {remedy}");
        // An installation of packages is what can change the answer.
        if Path::new("/var/lib/dpkg/status").exists() {
            println!("cargo::rerun-if-changed=/var/lib/dpkg/status");
        }
    }
}

fn is_set(name: &str) -> bool {
    env::var(name).is_ok_and(|v| !v.is_empty() && v != "0")
}

fn fail(message: &str) -> ! {
    println!("cargo::error={message}");
    process::exit(1);
}

/// Looks for headers with their library: `EMBREE_DIR` first, then the usual prefixes; Embree 4 before Embree 3.
fn find() -> Result<Found, String> {
    let own: Vec<PathBuf> =
        env::var_os("EMBREE_DIR").filter(|d| !d.is_empty()).map(PathBuf::from).into_iter().collect();
    let usual: Vec<PathBuf> =
        ["/usr", "/usr/local", "/opt/embree", "/opt/homebrew", "/opt/local"].map(PathBuf::from).into();
    let mut without_library = None;
    for prefixes in [&own, &usual] {
        for major in [4, 3] {
            for prefix in prefixes {
                let include = prefix.join("include");
                if !include.join(format!("embree{major}/rtcore.h")).is_file() {
                    continue;
                }
                match library_folder(prefix, major) {
                    Some(lib) => return Ok(Found { major, include, lib }),
                    None => without_library = without_library.or(Some((major, include))),
                }
            }
        }
    }
    Err(match without_library {
        Some((major, include)) => {
            let arch = env::var("CARGO_CFG_TARGET_ARCH").unwrap_or_default();
            let include = include.display();
            format!("{include} has headers of Embree {major} but there is no libembree{major} for {arch} beside them")
        }
        None => "no headers embree4/rtcore.h or embree3/rtcore.h were found".into(),
    })
}

/// The folder of a prefix that holds the library for the target; when cross compiling, `lib` may be that of the host.
fn library_folder(prefix: &Path, major: u32) -> Option<PathBuf> {
    let target = env::var("TARGET").unwrap_or_default();
    let arch = target.split('-').next().unwrap_or_default().to_owned();
    ["lib".to_owned(), "lib64".to_owned(), format!("lib/{arch}-linux-gnu")]
        .into_iter()
        .map(|folder| prefix.join(folder))
        .find(|folder| {
            let libraries = ["so", "dylib"].map(|ext| folder.join(format!("libembree{major}.{ext}")));
            libraries.iter().any(|file| file.exists() && !is_foreign(file))
        })
}

/// True for an ELF file of another processor.
fn is_foreign(library: &Path) -> bool {
    let machine = match env::var("CARGO_CFG_TARGET_ARCH").as_deref() {
        Ok("x86_64") => 62,
        Ok("aarch64") => 183,
        _ => return false,
    };
    let mut header = [0; 20];
    let read = fs::File::open(library).and_then(|mut file| file.read_exact(&mut header));
    read.is_ok() && header.starts_with(b"\x7fELF") && u16::from_le_bytes([header[18], header[19]]) != machine
}

/// Writes the bindings and tells this crate and its dependents what was found.
fn bind(found: &Found) -> Result<(), String> {
    let Found { major, include, lib } = found;
    let folder = include.join(format!("embree{major}"));
    let version = version(&folder.join("rtcore_config.h"))?;
    load_libclang()?;
    let bindings = bindgen::Builder::default()
        .header(folder.join("rtcore.h").to_string_lossy())
        .allowlist_function(FUNCTIONS)
        .allowlist_var(CONSTANTS)
        .allowlist_type("RTCSceneFlags|RTCIntersectArguments|RTCOccludedArguments|RTCRayHit16|RTCRayQueryFlags")
        .blocklist_type("_*ssize_t")
        .raw_line("pub type ssize_t = isize;")
        .default_enum_style(bindgen::EnumVariation::Consts)
        .prepend_enum_name(false)
        .derive_default(false)
        .layout_tests(true)
        .generate_comments(false)
        .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()))
        .generate()
        .map_err(|e| format!("bindgen cannot read the headers of Embree {version}: {}", one_line(&e.to_string())))?
        .to_string();
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("embree.rs");
    fs::write(&out, &bindings).map_err(|e| format!("cannot write {}: {e}", out.display()))?;

    println!("cargo::rustc-cfg=embree");
    println!("cargo::rustc-cfg=embree{major}");
    if bindings.contains("fn rtcGetDeviceLastErrorMessage") {
        println!("cargo::rustc-cfg=embree_error_text");
    }
    println!("cargo::rustc-env=EMBREE_HEADER_VERSION={version}");
    println!("cargo::rustc-link-search=native={}", lib.display());
    println!("cargo::rustc-link-lib=dylib=embree{major}");
    println!("cargo::metadata=VERSION={version}");
    println!("cargo::metadata=LIB={}", lib.display());
    Ok(())
}

/// Reads `#define RTC_VERSION_STRING "…"`.
fn version(config: &Path) -> Result<String, String> {
    let text = fs::read_to_string(config).map_err(|e| format!("cannot read {}: {e}", config.display()))?;
    text.lines()
        .find_map(|line| {
            line.trim().strip_prefix("#define RTC_VERSION_STRING")?.trim().strip_prefix('"')?.strip_suffix('"')
        })
        .map(str::to_owned)
        .ok_or_else(|| format!("{} names no version", config.display()))
}

/// bindgen panics when it finds no libclang; asks for it here, quietly, and turns the panic into an error.
fn load_libclang() -> Result<(), String> {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| {}));
    let loaded = panic::catch_unwind(bindgen::clang_version);
    panic::set_hook(hook);
    loaded.map(drop).map_err(|_| "libclang, which makes the bindings, was not found".into())
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
