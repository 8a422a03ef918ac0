//! Notes as W3C Web Annotations, for programs that show other people's.
//!
//! *Web Annotation Data Model* (W3C Recommendation, 23 February 2017) with the three-dimensional
//! targets of the IIIF Presentation API 4.0 as drafted in 2025 (context
//! `http://iiif.io/api/presentation/4/context.json`): a `PointSelector` with x, y and z, and a
//! `WktSelector` whose value is a `LINESTRING Z` or `POLYGON Z`. Drafts change: the year stands in the
//! `generator` of what is written.

use serde_json::{Value, json};

use super::{Note, NoteShape, Session};

/// The year of the draft whose types are used.
pub const DRAFT: &str = "IIIF Presentation API 4.0, draft of 2025";

/// An annotation page of all notes of a session, about the file called `target`, which is a name or an
/// address. Coordinates are the source's.
pub fn annotation_page(session: &Session, target: &str) -> Value {
    let id = |i: usize| format!("{target}#note-{}", i + 1);
    let items: Vec<Value> =
        session.notes.iter().enumerate().map(|(i, n)| annotation(n, &id(i), target)).collect();
    json!({
        "@context": [
            "http://www.w3.org/ns/anno.jsonld",
            "http://iiif.io/api/presentation/4/context.json",
        ],
        "id": format!("{target}#notes"),
        "type": "AnnotationPage",
        "generator": {
            "id": "https://example.org/hlod",
            "type": "Software",
            "name": format!("hlod-render {}; selectors after the {DRAFT}", env!("CARGO_PKG_VERSION")),
        },
        "items": items,
    })
}

fn annotation(note: &Note, id: &str, target: &str) -> Value {
    let mut bodies = vec![json!({
        "type": "TextualBody", "purpose": "commenting", "format": "text/plain",
        "value": if note.text.is_empty() { &note.title } else { &note.text },
    })];
    if !note.category.is_empty() {
        bodies.push(json!({
            "type": "TextualBody", "purpose": "tagging", "format": "text/plain",
            "value": note.category,
        }));
    }
    json!({
        "id": id,
        "type": "Annotation",
        "motivation": ["commenting"],
        "label": { "none": [note.title] },
        "body": bodies,
        "target": {
            "type": "SpecificResource",
            "source": { "id": target, "type": "Model" },
            "selector": [selector(note)],
            "styleClass": format!("colour-{}", note.colour.trim_start_matches('#')),
        },
    })
}

fn selector(note: &Note) -> Value {
    let coordinates = |closed: bool| {
        let mut corners: Vec<String> = note
            .points
            .iter()
            .map(|p| format!("{} {} {}", p.position[0], p.position[1], p.position[2]))
            .collect();
        if closed && let Some(first) = corners.first().cloned() {
            corners.push(first);
        }
        corners.join(", ")
    };
    match (note.shape, note.points.first()) {
        (NoteShape::Point, Some(p)) => {
            let [x, y, z] = p.position;
            json!({ "type": "PointSelector", "x": x, "y": y, "z": z })
        }
        (NoteShape::Region, _) => {
            let value = format!("POLYGON Z (({}))", coordinates(true));
            json!({ "type": "WktSelector", "value": value })
        }
        _ => {
            let value = format!("LINESTRING Z ({})", coordinates(false));
            json!({ "type": "WktSelector", "value": value })
        }
    }
}
