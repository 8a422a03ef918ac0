//! What a figure was made from and how, without dates and folders: the same command writes the same bytes.

use std::ffi::OsStr;
use std::fmt::Write;
use std::path::Path;

use hlod_compress::{Header, Metadata, Unit};
use tiff::tags::Tag;

use crate::camera::{Camera, Projection};
use crate::framing::Framing;
use crate::scene::{Light, Shot};

/// Text that goes into image files.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Provenance {
    /// Name of the model's file, without its folder.
    pub title: String,
    /// The scans that it was made from, a line each: name, bytes and SHA-256.
    pub sources: String,
    /// How the picture was taken, a line each: what and its value.
    pub description: String,
    /// The command that makes it again.
    pub command: String,
    /// What the file's metadata say of the scan, a line each: what and its value.
    pub about: String,
    /// Credit line and rights, as the metadata give them.
    pub rights: String,
}

impl Provenance {
    /// Of a model's file.
    pub fn new(model: &Path, header: &Header, command: &str) -> Provenance {
        let mut sources = String::new();
        for source in &header.sources {
            let sha: String = source.sha256.iter().map(|b| format!("{b:02x}")).collect();
            let name = printable(&source.base_name);
            let _ = writeln!(sources, "{name}, {} bytes, SHA-256 {sha}", source.file_bytes);
        }
        Provenance {
            title: base_name(model.as_os_str()),
            sources: sources.trim_end().to_owned(),
            command: printable(command),
            ..Provenance::default()
        }
    }

    /// Adds what is known of the scan besides its shape.
    pub fn add_about(&mut self, metadata: &Metadata) {
        let lines = metadata.lines();
        let is_rights = |name: &str| ["credit", "rights"].contains(&name);
        let rights = lines.iter().filter(|(name, _)| is_rights(name));
        self.rights = rights.map(|(_, text)| printable(text)).collect::<Vec<_>>().join("\n");
        let all = lines.iter().map(|(name, text)| format!("{name}: {}", printable(text)));
        self.about = all.collect::<Vec<_>>().join("\n");
    }

    /// Adds a line.
    pub fn add(&mut self, what: &str, value: &str) {
        if !self.description.is_empty() {
            self.description.push('\n');
        }
        let _ = write!(self.description, "{what}: {}", printable(value));
    }

    /// Adds what a shot says: light, shadows, errors; and its camera, relative to the statue.
    pub fn add_shot(&mut self, shot: &Shot, framing: &Framing, unit: Unit) {
        self.add("unit", unit.name());
        self.add("camera", &camera_text(&shot.camera, framing));
        self.add_light(shot, framing);
    }

    /// Adds light, shadows and errors.
    pub fn add_light(&mut self, shot: &Shot, framing: &Framing) {
        let light = match shot.light {
            Light::Directional(towards) => {
                let towards = towards.normalize_or_zero();
                let along = framing.axes.map(|axis| towards.dot(axis));
                format!("parallel, from {} (right, up, front)", numbers(&along))
            }
            Light::Point(p) => format!(
                "a lamp at {} (statue heights right, up, front of the centre)",
                numbers(&framing.relative(p))
            ),
        };
        self.add("light", &light);
        if let Some(spot) = &shot.spot {
            let along = framing.axes.map(|axis| spot.towards.dot(axis));
            let text = format!("{}° wide towards {}", number(spot.angle_deg), numbers(&along));
            self.add("spot", &text);
        }
        self.add("shadows", shot.shadow.name());
        if shot.enhance.strength > 0.0 {
            let (strength, radius) = (shot.enhance.strength, shot.enhance.radius_px);
            self.add("enhance", &format!("{strength} within {radius} px"));
        }
        self.add("representation", shot.representation.name());
        self.add("tau", &format!("{} px", number(shot.error_threshold_px)));
    }

    /// Keywords and texts of a PNG's chunks.
    pub(super) fn texts(&self) -> Vec<(&'static str, String)> {
        let all = [
            ("Title", self.title.clone()),
            ("Software", software()),
            ("Source", self.sources.clone()),
            ("Description", self.description.clone()),
            ("About", self.about.clone()),
            ("Copyright", self.rights.clone()),
            ("Comment", self.command.clone()),
        ];
        all.into_iter().filter(|(_, text)| !text.is_empty()).collect()
    }

    /// The same for TIFF, whose texts have no letters beyond ASCII.
    pub(super) fn tiff_texts(&self) -> Vec<(Tag, String)> {
        let all = [self.sources.as_str(), &self.about, &self.description, &self.command];
        let parts: Vec<&str> = all.into_iter().filter(|text| !text.is_empty()).collect();
        // DocumentName has no name of its own in the crate.
        let texts = [
            (Tag::Unknown(269), self.title.clone()),
            (Tag::ImageDescription, parts.join("\n")),
            (Tag::Software, software()),
            (Tag::Copyright, self.rights.clone()),
        ];
        let some = texts.into_iter().filter(|(_, text)| !text.is_empty());
        some.map(|(tag, text)| (tag, ascii(&text))).collect()
    }
}

/// Name and version of this program.
pub(super) fn software() -> String {
    format!("hlod-render {}", env!("CARGO_PKG_VERSION"))
}

/// The arguments of a program as one line that a shell reads, without folders, and without what does not
/// change the picture.
pub fn command_line<'a>(arguments: impl IntoIterator<Item = &'a OsStr>) -> String {
    let mut line = String::from("hlod-render");
    for argument in arguments.into_iter().skip(1) {
        let text = argument.to_string_lossy();
        if text.starts_with("--json") || ["-q", "--quiet"].contains(&text.as_ref()) {
            continue;
        }
        let named = match text.split_once('=') {
            Some((option, value)) if option.starts_with('-') => {
                format!("{option}={}", base_name(OsStr::new(value)))
            }
            _ => base_name(argument),
        };
        line.push(' ');
        line.push_str(&quoted(&named));
    }
    line
}

/// What follows the last separator of folders, without what a web address asks for.
fn base_name(path: &OsStr) -> String {
    let text = path.to_string_lossy();
    let text = match text.split_once("://") {
        Some((_, address)) => address.split(['?', '#']).next().unwrap_or(address),
        None => &text,
    };
    let name = text.trim_end_matches(['/', '\\']).rsplit(['/', '\\']).next().unwrap_or(text);
    printable(name)
}

fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_=.,:+".contains(c);
    match !argument.is_empty() && argument.chars().all(plain) {
        true => argument.to_owned(),
        false => format!("'{}'", argument.replace('\'', "'\\''")),
    }
}

/// Names come from outside: nothing in them is to end a line or move a cursor.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '?' } else { c }).collect()
}

fn ascii(text: &str) -> String {
    let letter = |c: char| -> String {
        if c.is_ascii() { c.to_string() } else { c.escape_unicode().to_string() }
    };
    text.chars().map(letter).collect()
}

fn camera_text(camera: &Camera, framing: &Framing) -> String {
    let places = [camera.eye, camera.target].map(|p| numbers(&framing.relative(p)));
    let projection = match camera.projection {
        Projection::Perspective { fov_y } => {
            format!("perspective, {}° from lower to upper side", number(fov_y.to_degrees()))
        }
        Projection::Orthographic { height } => {
            format!("parallel, {} of the file's unit high", number(height))
        }
    };
    format!("{}:{} (statue heights), {projection}", places[0], places[1])
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(",")
}

/// Six digits after the point at most.
fn number(value: f64) -> String {
    let text = format!("{value:.6}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_lose_their_folders_and_nothing_else() {
        let given = [
            "/opt/bin/hlod-render",
            "shot",
            "/home/somebody/my statue.hlod",
            "-o",
            "../out/a.png",
            "--json=/tmp/x.json",
            "--scale",
            "1:5",
            "--camera=-0.1,0,1:0,0,0",
            "--caption",
            "it's",
        ];
        let line = command_line(given.map(OsStr::new));
        let expected = "hlod-render shot 'my statue.hlod' -o a.png --scale 1:5 \
                        --camera=-0.1,0,1:0,0,0 --caption 'it'\\''s'";
        assert_eq!(line, expected);
        let address = OsStr::new("https://user:secret@example.org/a/b.hlod?key=1");
        assert_eq!(base_name(address), "b.hlod");
    }

    #[test]
    fn names_from_outside_cannot_break_lines() {
        let mut p = Provenance::default();
        p.add("unit", "mm\nlight: none");
        assert_eq!(p.description, "unit: mm?light: none");
        assert_eq!(ascii("τ"), "\\u{3c4}");
        assert_eq!((number(-0.0000001), number(2.5)), ("0".to_owned(), "2.5".to_owned()));
    }
}
