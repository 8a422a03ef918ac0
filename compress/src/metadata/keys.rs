//! The keys that are known: their kinds, and how their values read.
//!
//! | key | what | after |
//! |---|---|---|
//! | `label` | what the scan shows | IIIF `label`; CRM P102 has title |
//! | `summary` | a few sentences | IIIF `summary`; CRM P3 has note |
//! | `identifier` | inventory number | CRM P48 has preferred identifier |
//! | `holder` | who keeps the object | CRM P50 has current keeper |
//! | `rights` | URI of a licence or statement | IIIF `rights`; CRM P104 is subject to |
//! | `requiredStatement` | credit line: `label`, `value` | IIIF `requiredStatement` |
//! | `digitization` | how it was scanned | CRMdig D2 Digitization Process |
//! | `digitization.device` | with what | CRMdig L12 happened on device (D8 Digital Device) |
//! | `digitization.date` | day, or first/last day | CRM P4 has time-span |
//! | `digitization.operator` | by whom | CRM P14 carried out by |
//! | `digitization.accuracy` | `value`, `unit`, `k`, `source` | expanded uncertainty, JCGM 100:2008, 6 |
//! | `processing` | steps since: `software`, `description`, `date` | CRMdig D3 Formal Derivation |
//!
//! Texts for people are strings, or after IIIF (section 4) arrays of strings by language:
//! `{"en": ["…"], "de": ["…"]}`.

use serde_json::{Map, Value};

use super::printable;
use crate::Unit;

/// A known key.
struct Key {
    name: &'static str,
    /// For people; empty where what is inside has names of its own.
    title: &'static str,
    kind: Kind,
    required: bool,
}

/// What a value must be.
enum Kind {
    /// A string that says something.
    Text,
    /// The same, or texts by language.
    Languages,
    /// An absolute URI (RFC 3986): a scheme, and no white space.
    Uri,
    /// A calendar date (ISO 8601-1:2019, 5.2.2) of reduced precision or not, or two with a slash.
    Date,
    Positive,
    NotNegative,
    Unit,
    Object(&'static [Key]),
    /// Of objects, or of texts where only the description is known.
    Steps(&'static [Key]),
}

const fn key(name: &'static str, title: &'static str, kind: Kind) -> Key {
    Key { name, title, kind, required: false }
}

const fn required(name: &'static str, title: &'static str, kind: Kind) -> Key {
    Key { name, title, kind, required: true }
}

/// In the order in which people want to read them.
const KEYS: &[Key] = &[
    key("label", "title", Kind::Languages),
    key("identifier", "inventory number", Kind::Text),
    key("holder", "holder", Kind::Languages),
    key("summary", "summary", Kind::Languages),
    key("rights", "rights", Kind::Uri),
    key("requiredStatement", "", Kind::Object(STATEMENT)),
    key("digitization", "", Kind::Object(DIGITIZATION)),
    key("processing", "processing", Kind::Steps(STEP)),
    key("$schema", "", Kind::Text),
];
const STATEMENT: &[Key] =
    &[required("label", "", Kind::Languages), required("value", "credit", Kind::Languages)];
const DIGITIZATION: &[Key] = &[
    key("device", "device", Kind::Languages),
    key("date", "date", Kind::Date),
    key("operator", "operator", Kind::Languages),
    key("accuracy", "", Kind::Object(ACCURACY)),
];
const ACCURACY: &[Key] = &[
    required("value", "", Kind::NotNegative),
    required("unit", "", Kind::Unit),
    required("k", "", Kind::Positive),
    required("source", "", Kind::Text),
];
const STEP: &[Key] = &[
    key("software", "", Kind::Text),
    required("description", "", Kind::Languages),
    key("date", "", Kind::Date),
];

/// Says what is wrong, and where.
pub(super) fn check(root: &Map<String, Value>) -> Result<(), String> {
    check_object(root, KEYS, "")
}

fn check_object(object: &Map<String, Value>, keys: &[Key], at: &str) -> Result<(), String> {
    for key in keys {
        let path = join(at, key.name);
        match object.get(key.name) {
            Some(value) => check_value(value, &key.kind, &path)?,
            None if key.required => {
                return Err(format!("{path} is missing: {}", key.kind.expected()));
            }
            None => {}
        }
    }
    Ok(())
}

fn check_value(value: &Value, kind: &Kind, path: &str) -> Result<(), String> {
    let good = match (kind, value) {
        (Kind::Object(keys), Value::Object(object)) => return check_object(object, keys, path),
        (Kind::Steps(keys), Value::Array(steps)) => {
            let one = |(i, step): (usize, &Value)| match step {
                Value::Object(object) => check_object(object, keys, &format!("{path}[{i}]")),
                other => check_value(other, &Kind::Text, &format!("{path}[{i}]")),
            };
            return steps.iter().enumerate().try_for_each(one);
        }
        (Kind::Text, Value::String(text)) => !text.trim().is_empty(),
        (Kind::Languages, Value::String(text)) => !text.trim().is_empty(),
        (Kind::Languages, Value::Object(languages)) => {
            let is_texts = |texts: &Value| {
                let texts = texts.as_array();
                texts.is_some_and(|all| !all.is_empty() && all.iter().all(Value::is_string))
            };
            !languages.is_empty() && languages.values().all(is_texts)
        }
        (Kind::Uri, Value::String(text)) => is_uri(text),
        (Kind::Date, Value::String(text)) => is_date_or_span(text),
        (Kind::Positive, Value::Number(number)) => number.as_f64().is_some_and(|v| v > 0.0),
        (Kind::NotNegative, Value::Number(number)) => number.as_f64().is_some_and(|v| v >= 0.0),
        (Kind::Unit, Value::String(text)) => {
            text.parse().is_ok_and(|unit: Unit| unit != Unit::Unknown)
        }
        _ => false,
    };
    if good { Ok(()) } else { Err(format!("{path}: {}, found {}", kind.expected(), short(value))) }
}

impl Kind {
    fn expected(&self) -> &'static str {
        match self {
            Kind::Text => "expected a text",
            Kind::Languages => "expected a text, or texts by language as in {\"en\": [\"…\"]}",
            Kind::Uri => {
                "expected an address, as in \"http://creativecommons.org/licenses/by/4.0/\""
            }
            Kind::Date => "expected a date, as in \"2024-05-13\" or \"2024-05-13/2024-05-17\"",
            Kind::Positive => "expected a positive number",
            Kind::NotNegative => "expected a number, 0 or more",
            Kind::Unit => "expected \"mm\", \"cm\", \"m\", \"um\" or \"in\"",
            Kind::Object(_) => "expected an object, { … }",
            Kind::Steps(_) => "expected a list of steps, [ … ]",
        }
    }
}

fn join(at: &str, name: &str) -> String {
    if at.is_empty() { name.to_owned() } else { format!("{at}.{name}") }
}

/// A value as far as a message has room for it.
fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

fn is_uri(text: &str) -> bool {
    let Some((scheme, rest)) = text.split_once(':') else { return false };
    let letter = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(letter)
        && !rest.is_empty()
        && !rest
            .contains(|c: char| c.is_whitespace() || c.is_control() || "<>\"{}|\\^`".contains(c))
}

fn is_date_or_span(text: &str) -> bool {
    match text.split_once('/') {
        Some((first, last)) => is_date(first) && is_date(last) && first <= last,
        None => is_date(text),
    }
}

/// YYYY, YYYY-MM or YYYY-MM-DD.
fn is_date(text: &str) -> bool {
    let digits = |part: &str, count: usize| -> Option<u32> {
        let all = part.len() == count && part.bytes().all(|b| b.is_ascii_digit());
        all.then(|| part.parse().ok()).flatten()
    };
    let mut parts = text.split('-');
    let Some(year) = parts.next().and_then(|year| digits(year, 4)) else { return false };
    let Some(month) = parts.next() else { return true };
    let Some(month) = digits(month, 2) else { return false };
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = match month {
        2 => 28 + u32::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return false,
    };
    match (parts.next(), parts.next()) {
        (None, _) => true,
        (Some(day), None) => digits(day, 2).is_some_and(|day| (1..=days).contains(&day)),
        _ => false,
    }
}

pub(super) fn unknown(root: &Map<String, Value>) -> Vec<String> {
    let mut out = Vec::new();
    unknown_in(root, KEYS, "", &mut out);
    out
}

fn unknown_in(object: &Map<String, Value>, keys: &[Key], at: &str, out: &mut Vec<String>) {
    for (name, value) in object {
        let path = join(at, name);
        match (keys.iter().find(|key| key.name == name).map(|key| &key.kind), value) {
            (None, _) => out.push(printable(&path)),
            (Some(Kind::Object(keys)), Value::Object(inner)) => unknown_in(inner, keys, &path, out),
            (Some(Kind::Steps(keys)), Value::Array(steps)) => {
                for (i, step) in steps.iter().enumerate() {
                    if let Value::Object(inner) = step {
                        unknown_in(inner, keys, &format!("{path}[{i}]"), out);
                    }
                }
            }
            _ => {}
        }
    }
}

/// A text for people: of languages English, else what has none, else the first.
fn text_of(value: &Value) -> String {
    let text = match value {
        Value::Object(languages) => {
            let preferred = ["en", "none"].into_iter().find_map(|l| languages.get(l));
            let texts = preferred.or_else(|| languages.values().next()).and_then(Value::as_array);
            let texts = texts.into_iter().flatten().filter_map(Value::as_str);
            texts.collect::<Vec<_>>().join("; ")
        }
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    printable(&text)
}

pub(super) fn required_statement(root: &Map<String, Value>) -> Option<String> {
    root.get("requiredStatement")?.get("value").map(text_of)
}

pub(super) fn lines(root: &Map<String, Value>) -> Vec<(String, String)> {
    let mut out = Vec::new();
    lines_of(root, KEYS, &mut out);
    out
}

fn lines_of(object: &Map<String, Value>, keys: &[Key], out: &mut Vec<(String, String)>) {
    for key in keys {
        let line = match (&key.kind, object.get(key.name)) {
            (_, None) => continue,
            (Kind::Object(_), Some(Value::Object(inner))) if key.name == "accuracy" => {
                ("accuracy", accuracy_text(inner))
            }
            (Kind::Object(keys), Some(Value::Object(inner))) => {
                lines_of(inner, keys, out);
                continue;
            }
            (Kind::Steps(_), Some(Value::Array(steps))) => {
                let step = |step: &Value| (key.title.to_owned(), step_text(step));
                out.extend(steps.iter().map(step));
                continue;
            }
            (_, Some(_)) if key.title.is_empty() => continue,
            (_, Some(value)) => (key.title, text_of(value)),
        };
        out.push((line.0.to_owned(), line.1));
    }
}

fn accuracy_text(accuracy: &Map<String, Value>) -> String {
    let of = |name: &str| accuracy.get(name).map(text_of).unwrap_or_default();
    format!("U = {} {} (k = {}), {}", of("value"), of("unit"), of("k"), of("source"))
}

fn step_text(step: &Value) -> String {
    let Value::Object(inner) = step else { return text_of(step) };
    let names = ["date", "software", "description"];
    let parts: Vec<String> = names.iter().filter_map(|n| inner.get(*n)).map(text_of).collect();
    parts.join(": ")
}

/// Names of all known keys as paths, for comparing with the schema.
#[cfg(test)]
pub(super) fn all() -> Vec<(String, bool)> {
    fn add(keys: &[Key], at: &str, out: &mut Vec<(String, bool)>) {
        for key in keys {
            let path = join(at, key.name);
            if let Kind::Object(inner) | Kind::Steps(inner) = key.kind {
                add(inner, &path, out);
            }
            out.push((path, key.required));
        }
    }
    let mut out = Vec::new();
    add(KEYS, "", &mut out);
    out
}
