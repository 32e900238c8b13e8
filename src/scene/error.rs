use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A place in a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Position {
    pub file: Arc<Path>,
    /// Counted from 1.
    pub line: u32,
    /// In characters, counted from 1.
    pub col: u32,
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.file.display(), self.line, self.col)
    }
}

/// What is wrong with a scene, where, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneError {
    pub file: PathBuf,
    /// Counted from 1.
    pub line: u32,
    /// In characters, counted from 1.
    pub col: u32,
    /// What was found.
    pub message: String,
    /// What is known or allowed instead; may be empty.
    pub help: String,
}

impl SceneError {
    pub fn at(pos: &Position, message: impl Into<String>) -> Self {
        Self {
            file: pos.file.to_path_buf(),
            line: pos.line,
            col: pos.col,
            message: message.into(),
            help: String::new(),
        }
    }

    /// Adds the remedy that follows the message after a semicolon.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = help.into();
        self
    }

    /// Adds the nearest of `known` as a suggestion, or lists them all when there are few and none is near.
    pub fn suggest<S: AsRef<str>>(self, found: &str, known: &[S]) -> Self {
        let help = suggestion(found, known);
        self.help(help)
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}: {}", self.file.display(), self.line, self.col, self.message)?;
        if !self.help.is_empty() {
            write!(f, "; {}", self.help)?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneError {}

/// `did you mean "…"?` for the nearest known word, otherwise the list of known words.
pub(crate) fn suggestion<S: AsRef<str>>(found: &str, known: &[S]) -> String {
    // Compare without case and separators, and never spend long on a giant word.
    let plain = |s: &str| s.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect::<String>();
    let word = plain(&found.chars().take(64).collect::<String>());
    let nearest = known
        .iter()
        .map(|k| (k.as_ref(), strsim::damerau_levenshtein(&word, &plain(k.as_ref()))))
        .min_by_key(|&(_, distance)| distance);
    match nearest {
        Some((k, distance)) if distance <= (word.len().max(k.len()) / 3).max(1) && distance < word.len().max(1) => {
            format!("did you mean \"{k}\"?")
        }
        Some(_) if known.len() <= 40 => {
            format!("known are {}", known.iter().map(AsRef::as_ref).collect::<Vec<_>>().join(", "))
        }
        Some((k, _)) => format!("the nearest known name is \"{k}\""),
        None => "nothing is allowed here".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_place_thing_and_remedy() {
        let pos = Position { file: Path::new("scene.xml").into(), line: 12, col: 5 };
        let e = SceneError::at(&pos, "unknown bsdf plugin \"difuse\"").suggest("difuse", &["conductor", "diffuse"]);
        assert_eq!(e.to_string(), "scene.xml:12:5: unknown bsdf plugin \"difuse\"; did you mean \"diffuse\"?");
        assert_eq!(suggestion("zzz", &["a", "b"]), "known are a, b");
        assert_eq!(suggestion("kind", &["id", "name"]), "known are id, name");
        assert_eq!(suggestion("visibile", &["independent", "visibility"]), "did you mean \"visibility\"?");
        assert_eq!(suggestion("intIOR", &["ext_ior", "int_ior"]), "did you mean \"int_ior\"?");
    }
}
