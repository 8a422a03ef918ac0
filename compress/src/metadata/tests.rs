use super::*;

fn parse(text: &str) -> Result<Metadata, FormatError> {
    Metadata::parse(text.as_bytes())
}

#[test]
fn the_example_is_good_and_reads_as_it_should() {
    let example = parse(METADATA_EXAMPLE).unwrap();
    assert_eq!(example.text(), METADATA_EXAMPLE);
    assert!(example.unknown_keys().is_empty());
    let lines = example.lines();
    let line = |title: &str| lines.iter().find(|l| l.0 == title).map(|l| l.1.as_str());
    assert_eq!(line("title"), Some("Head of a woman"));
    assert_eq!(line("credit"), Some("Scan: A. Example, by courtesy of the Museum of Casts"));
    assert_eq!(example.required_statement().as_deref(), line("credit"));
    assert_eq!(
        line("accuracy"),
        Some("U = 0.05 mm (k = 2), calibration certificate 12 of 2024-03-01")
    );
    assert_eq!(lines.iter().filter(|l| l.0 == "processing").count(), 2);
    let source = "calibration certificate 12 of 2024-03-01".to_owned();
    let accuracy = Accuracy { value: 0.05, unit: Unit::Millimetre, k: 2.0, source };
    assert_eq!(example.accuracy(), Some(accuracy));
    assert_eq!(parse("{}").unwrap().accuracy(), None);
}

/// Each known key with a value of a wrong kind is refused by its path and what was expected; the same
/// with a right one is not.
#[test]
fn wrong_kinds_are_refused_by_key() {
    for (wrong, right, says) in [
        (r#"{"label": 3}"#, r#"{"label": "3"}"#, "label: expected a text"),
        (r#"{"label": {"en": "x"}}"#, r#"{"label": {"en": ["x"]}}"#, "label: expected"),
        (r#"{"identifier": " "}"#, r#"{"identifier": "7"}"#, "identifier: expected a text"),
        (r#"{"rights": "CC BY"}"#, r#"{"rights": "urn:x"}"#, "rights: expected an address"),
        (
            r#"{"requiredStatement": "x"}"#,
            r#"{"requiredStatement": {"label": "a", "value": "b"}}"#,
            "requiredStatement: expected an object",
        ),
        (
            r#"{"requiredStatement": {"label": "a"}}"#,
            r#"{"requiredStatement": {"label": "a", "value": "b"}}"#,
            "requiredStatement.value is missing",
        ),
        (
            r#"{"digitization": {"date": "2023-02-29"}}"#,
            r#"{"digitization": {"date": "2024-02-29"}}"#,
            "digitization.date: expected a date",
        ),
        (
            r#"{"digitization": {"date": "2024-05/2024-04"}}"#,
            r#"{"digitization": {"date": "2024-04/2024-05"}}"#,
            "digitization.date: expected a date",
        ),
        (
            r#"{"digitization": {"accuracy": {"value": 1, "unit": "mm", "k": 0, "source": "x"}}}"#,
            r#"{"digitization": {"accuracy": {"value": 1, "unit": "mm", "k": 2, "source": "x"}}}"#,
            "digitization.accuracy.k: expected a positive number, found 0",
        ),
        (
            r#"{"digitization": {"accuracy": {"value": 1, "unit": "unknown", "k": 2, "source": "x"}}}"#,
            r#"{"digitization": {"accuracy": {"value": 0, "unit": "in", "k": 2, "source": "x"}}}"#,
            "digitization.accuracy.unit: expected \"mm\"",
        ),
        (
            r#"{"processing": [{"description": "x"}, {"software": "y"}]}"#,
            r#"{"processing": ["w", {"description": "x"}]}"#,
            "processing[1].description is missing",
        ),
        (r#"{"processing": {}}"#, r#"{"processing": []}"#, "processing: expected a list"),
        ("[]", "{}", "expected an object"),
        ("{\"a\": 1,}", "{\"a\": 1}", "it is no JSON"),
    ] {
        let error = parse(wrong).unwrap_err().to_string();
        assert!(error.contains(says), "{wrong}: {error}");
        parse(right).unwrap();
    }
}

#[test]
fn unknown_keys_are_named_and_kept() {
    let text = r#"{"material": "marble", "digitization": {"weather": "dry"},
        "processing": [{"description": "x", "hours": 3}]}"#;
    let metadata = parse(text).unwrap();
    let mut unknown = metadata.unknown_keys();
    unknown.sort();
    assert_eq!(unknown, ["digitization.weather", "material", "processing[0].hours"]);
    assert_eq!(metadata.value()["material"], "marble");
    assert_eq!(metadata.text(), text);
}

#[test]
fn texts_from_outside_cannot_break_lines_or_grow() {
    let metadata = parse(r#"{"label": "a\nb\u001b[31m", "x\ny": 1}"#).unwrap();
    assert_eq!(metadata.lines()[0].1, "a b [31m");
    assert_eq!(metadata.unknown_keys(), ["x y"]);
    let long = format!(r#"{{"x": "{}"}}"#, "y".repeat(METADATA_BYTES_MAX));
    assert!(matches!(parse(&long), Err(FormatError::TooLarge { .. })));
    assert!(parse(&long[..0]).is_err());
    assert!(Metadata::parse(b"{\"x\": \"\xff\"}").is_err());
    assert!(parse(&"[".repeat(100_000)).is_err());
}

/// The schema and the table of keys name the same keys, and require the same.
#[test]
fn the_schema_says_what_is_checked() {
    fn add(schema: &Value, at: &str, out: &mut Vec<(String, bool)>) {
        let object = match schema.get("items") {
            Some(items) => &items["anyOf"][1],
            None => schema,
        };
        let required = object["required"].as_array().cloned().unwrap_or_default();
        let none = Map::new();
        for (name, inner) in object["properties"].as_object().unwrap_or(&none) {
            let path = if at.is_empty() { name.clone() } else { format!("{at}.{name}") };
            add(inner, &path, out);
            out.push((path, required.iter().any(|r| r == name)));
        }
    }
    let schema: Value = serde_json::from_str(METADATA_SCHEMA).unwrap();
    let mut of_schema = Vec::new();
    add(&schema, "", &mut of_schema);
    let mut of_table = keys::all();
    of_schema.sort();
    of_table.sort();
    assert!(of_schema.len() > 15);
    assert_eq!(of_schema, of_table);
}
