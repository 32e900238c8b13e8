//! The program as a user meets it, in a folder of its own.

use std::path::PathBuf;
use std::process::{Command, Output};

/// A temporary folder with a scene in it, in which the program runs.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// With the text as `scene.xml`.
    pub fn new(scene: &str) -> Self {
        let dir = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(dir.path().join("scene.xml"), scene).expect("a temporary file");
        Self(dir)
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub fn text(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).expect("a text")
    }

    pub fn image(&self, name: &str) -> caustica::image::Image {
        caustica::image::read(self.path(name)).expect("a readable image")
    }

    /// `caustica` with arguments separated by spaces.
    pub fn command(&self, args: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_caustica"));
        command.args(args.split_whitespace()).current_dir(self.0.path());
        command
    }

    pub fn run(&self, args: &str) -> Output {
        self.command(args).output().expect("the program starts")
    }

    /// What a run that must go well prints.
    #[track_caller]
    pub fn succeeds(&self, args: &str) -> String {
        let o = self.run(args);
        assert!(o.status.success(), "{args}: {}", String::from_utf8_lossy(&o.stderr));
        String::from_utf8(o.stdout).expect("a text")
    }

    /// The JSON that a run that must go well prints.
    #[track_caller]
    pub fn json(&self, args: &str) -> serde_json::Value {
        serde_json::from_str(&self.succeeds(args)).expect("one JSON object")
    }

    /// A run that must end with `code` and a message that has all `parts`.
    #[track_caller]
    pub fn fails(&self, args: &str, code: i32, parts: &[&str]) {
        let o = self.run(args);
        let text = String::from_utf8_lossy(&o.stderr);
        assert_eq!(o.status.code(), Some(code), "{args}: {text}");
        for part in parts {
            assert!(text.contains(part), "{args}: {part:?} is not in: {text}");
        }
        assert!(!text.contains("panicked"), "{args}: {text}");
    }
}
