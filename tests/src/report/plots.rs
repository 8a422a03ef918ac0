//! Plots as SVG.

use std::path::Path;

use plotters::prelude::*;

use super::error::ReportError;

/// One line of a plot.
pub(super) struct Curve<'a> {
    pub(super) name: &'a str,
    pub(super) points: Vec<(f64, f64)>,
}

/// Colours that the colour-blind tell apart (Okabe and Ito 2008).
const COLOURS: [RGBColor; 4] =
    [RGBColor(0, 114, 178), RGBColor(213, 94, 0), RGBColor(0, 158, 115), RGBColor(204, 121, 167)];

/// Draws curves from 0 upwards, with their names.
pub(super) fn plot_curves(
    path: &Path,
    caption: &str,
    (along, up): (&str, &str),
    curves: &[Curve<'_>],
) -> Result<(), ReportError> {
    draw(path, caption, (along, up), curves)
        .map_err(|error| ReportError::unexpected(path.display(), error))
}

fn draw(
    path: &Path,
    caption: &str,
    (along, up): (&str, &str),
    curves: &[Curve<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let right = points().map(|p| p.0).fold(1.0, f64::max);
    // Names stand above the curves.
    let top = 1.35 * points().map(|p| p.1).fold(0.0, f64::max);
    let area = SVGBackend::new(path, (900, 360)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(caption, ("sans-serif", 16))
        .margin(10)
        // Half of the last number along the axis.
        .margin_right(32)
        .x_label_area_size(36)
        .y_label_area_size(60)
        .build_cartesian_2d(0.0..right, 0.0..top.max(1e-9))?;
    chart.configure_mesh().x_desc(along).y_desc(up).light_line_style(WHITE).draw()?;
    for (curve, colour) in curves.iter().zip(COLOURS.iter().cycle()) {
        let line = LineSeries::new(curve.points.iter().copied(), colour.stroke_width(2));
        let key = move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2));
        chart.draw_series(line)?.label(curve.name).legend(key);
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .border_style(BLACK.mix(0.2))
        .background_style(WHITE)
        .draw()?;
    area.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_lie_within_the_picture() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plot.svg");
        let points = vec![(0.0, 1.0), (350_000.0, 3.0)];
        plot_curves(&path, "caption", ("frame", "ms"), &[Curve { name: "one", points }]).unwrap();
        let svg = std::fs::read_to_string(path).unwrap();
        let mut numbers = 0;
        for text in svg.split("<text ").skip(1).filter(|text| text.contains("\"middle\"")) {
            let x: f64 = text.split('"').nth(1).and_then(|x| x.parse().ok()).expect("its place");
            let label = text.split(['>', '<']).nth(1).expect("its text").trim();
            // Digits of the sizes in use are no wider.
            let half = 3.5 * label.chars().count() as f64;
            assert!(x - half >= 0.0 && x + half <= 900.0, "{label} at {x}");
            numbers += u32::from(label.starts_with('3'));
        }
        assert!(numbers > 0, "the axis has numbers");
    }
}
