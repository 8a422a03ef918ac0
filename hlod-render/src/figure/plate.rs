//! A plate: views of one statue at one scale, laid out as drawings are.
//!
//! Side views stand in a row on a common base line, the top view lies above the front and the bottom view
//! below it, each where it would be if the sides of a glass box round the statue were folded open (first
//! the left side, then front, right, back: third-angle projection, ISO 5456-2). A millimetre of the
//! statue is the same length everywhere.

use glam::DVec3;
use hlod_compress::Unit;

use super::camera::{extent, orthographic};
use super::font::Font;
use super::marks::Mark;
use super::outline::outline;
use super::provenance::software;
use super::scale::Scale;
use super::scale_bar::ScaleBar;
use super::sheet::{PlacedView, Sheet};
use crate::camera::Camera;
use crate::error::RenderError;
use crate::framing::Framing;
use crate::scene::{Light, Shot};
use crate::section::Section;

/// Free paper round the page, between views, and round what is drawn in each, mm.
const MARGIN_MM: f64 = 8.0;
const GAP_MM: f64 = 8.0;
const ROUND_MM: f64 = 0.5;
/// Heights of lines: of labels, of the title and of the footer, mm. 3.5 mm are 10 points.
const LABEL_MM: f64 = 3.5;
const TITLE_MM: f64 = 4.6;
const FOOTER_MM: f64 = 3.0;
/// No page is narrower: the footer needs room.
const WIDTH_MIN_MM: f64 = 80.0;
/// A scale bar is no longer than this.
const BAR_MM: f64 = 60.0;
/// Width of a section's lines, mm.
const LINE_MM: f64 = 0.25;
const INK: [u8; 3] = [20, 20, 20];

/// A side that a plate shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Side {
    /// From its left, which is the viewer's when it is seen from the front.
    Left,
    /// From before it.
    Front,
    /// From its other side.
    Right,
    /// From behind.
    Back,
    /// From above, the front below.
    Top,
    /// From below, the front above.
    Bottom,
}

impl Side {
    /// All of them with their names.
    pub const ALL: [(Side, &'static str); 6] = [
        (Side::Front, "front"),
        (Side::Left, "left"),
        (Side::Back, "back"),
        (Side::Right, "right"),
        (Side::Top, "top"),
        (Side::Bottom, "bottom"),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Side::ALL.iter().find(|(side, _)| *side == self).map_or("", |(_, name)| name)
    }

    /// Names with commas between them.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse_list(text: &str) -> Result<Vec<Side>, String> {
        let mut sides = Vec::new();
        for name in text.split(',') {
            let found = Side::ALL.iter().find(|(_, known)| *known == name.trim());
            let side = found.ok_or("expected some of front,left,back,right,top,bottom")?.0;
            if sides.contains(&side) {
                return Err(format!("{} is there twice", side.name()));
            }
            sides.push(side);
        }
        Ok(sides)
    }

    /// Towards the viewer, and up in the picture.
    fn axes(self, framing: &Framing) -> (DVec3, DVec3) {
        let [right, up, front] = framing.axes;
        match self {
            Side::Front => (front, up),
            Side::Back => (-front, up),
            Side::Left => (-right, up),
            Side::Right => (right, up),
            Side::Top => (up, -front),
            Side::Bottom => (-up, front),
        }
    }
}

/// What a plate is to show.
#[derive(Debug, Clone)]
pub struct Plate {
    /// Views.
    pub sides: Vec<Side>,
    /// Scale and resolution.
    pub scale: Scale,
    /// Unit of the statue's coordinates.
    pub unit: Unit,
    /// Title.
    pub title: String,
    /// Paper that is not there.
    pub transparent: bool,
    /// Samples of a pixel along each side.
    pub supersampling: u32,
}

/// Where a view lies on a page, for measuring in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laid {
    /// Which.
    pub side: Side,
    /// The view.
    pub view: PlacedView,
}

/// Parallel light from the upper left, 45° to the line of sight: a third of right angles between the picture's
/// diagonal and the viewer, as shading of drawings has it.
pub fn light(camera: &Camera) -> Light {
    let [right, up, back] = camera.axes();
    Light::Directional(-0.5 * right + 0.5 * up + back * 0.5f64.sqrt())
}

impl Plate {
    /// Lays the page out; `shot` says all but camera, light and background.
    ///
    /// # Errors
    /// When the unit is unknown, or the page is larger than can be drawn.
    pub fn lay_out(
        &self,
        framing: &Framing,
        shot: &Shot,
    ) -> Result<(Sheet, Vec<Laid>), RenderError> {
        let pixel = self.scale.pixel_in(self.unit)?;
        let px = |mm: f64| (mm / self.scale.pixel_on_paper_mm()).round().max(1.0) as u32;
        let mut laid = Vec::new();
        for side in &self.sides {
            laid.push(self.view(*side, framing, shot, pixel, px(ROUND_MM))?);
        }
        let content = place(&mut laid, px(MARGIN_MM), px(GAP_MM), px(LABEL_MM) * 3 / 2);
        let width = (content.0 + px(MARGIN_MM)).max(px(WIDTH_MIN_MM));
        // A page that is wider than what it shows shows it in its middle.
        let shift = (width - content.0 - px(MARGIN_MM)) / 2;
        laid.iter_mut().for_each(|l| l.view.x += shift);
        let mut sheet = Sheet {
            width,
            height: content.1,
            paper: [255; 3],
            transparent: self.transparent,
            views: laid.iter().map(|l| l.view).collect(),
            marks: Vec::new(),
            supersampling: self.supersampling,
            part_px: None,
        };
        sheet.check()?;
        let font = Font::new()?;
        for Laid { side, view } in &laid {
            let height = f64::from(px(LABEL_MM));
            let x = view.x + (view.width.saturating_sub(font.width(side.name(), height))) / 2;
            let y = view.y + view.height + px(LABEL_MM) / 4;
            sheet.marks.push(font.line(side.name(), (x.into(), y.into()), height, INK));
        }
        self.add_footer(&mut sheet, &font, pixel, &px);
        sheet.check()?;
        Ok((sheet, laid))
    }

    /// Adds a section at the same scale, to the right of everything, and where it is upright at the
    /// height that it has in the views beside it. Returns where its bounds begin on the page, from the
    /// left and from above; `None` where the plane met nothing.
    ///
    /// # Errors
    /// When the unit is unknown, or the page becomes larger than can be drawn.
    pub fn add_section(
        &self,
        sheet: &mut Sheet,
        laid: &[Laid],
        (section, name): (&Section, &str),
        framing: &Framing,
    ) -> Result<Option<(u32, u32)>, RenderError> {
        let pixel = self.scale.pixel_in(self.unit)?;
        let px = |mm: f64| (mm / self.scale.pixel_on_paper_mm()).round().max(1.0) as u32;
        let width = (LINE_MM / self.scale.pixel_on_paper_mm()).max(1.0);
        let Some(([low, _], (mut mark, round))) =
            section.bounds().zip(outline(section, pixel, width, INK))
        else {
            return Ok(None);
        };
        let row = laid.iter().filter(|l| !matches!(l.side, Side::Top | Side::Bottom));
        let base = row.map(|l| l.view.y + l.view.height - px(ROUND_MM)).max();
        let base = base.unwrap_or_else(|| px(MARGIN_MM) + mark.height);
        // How far it begins above the statue's lowest point.
        let up = framing.axes[1];
        let statue_low = framing.centre.dot(up) - framing.half[1];
        let is_upright = section.frame.v.dot(up) > 0.999;
        let raised = if is_upright {
            let lowest = section.frame.to_space(low).dot(up);
            ((lowest - statue_low) / pixel).round().max(0.0)
        } else {
            0.0
        };
        let content = laid.iter().map(|l| l.view.x + l.view.width).max().unwrap_or(0);
        let x = content.max(px(MARGIN_MM)) + px(GAP_MM);
        let bottom = i64::from(base) - raised as i64 + i64::from(round);
        let y = (bottom - i64::from(mark.height)).max(px(MARGIN_MM).into());
        (mark.x, mark.y) = (x.into(), y);
        let corner = (x + round, y as u32 + round);
        sheet.width = sheet.width.max(x + mark.width + px(MARGIN_MM));
        sheet.height = sheet.height.max(y as u32 + mark.height + px(LABEL_MM) * 2 + px(MARGIN_MM));

        let font = Font::new()?;
        let height = f64::from(px(LABEL_MM));
        let name = font.fitted(name, height, mark.width.max(px(WIDTH_MIN_MM / 2.0)));
        let at = x + mark.width.saturating_sub(font.width(&name, height)) / 2;
        // As low as the views' own names, unless the section reaches farther down.
        let lowest = i64::from(base).max(y + i64::from(mark.height - round));
        let below = lowest + i64::from(px(ROUND_MM) + px(LABEL_MM) / 4);
        sheet.width = sheet.width.max(at + font.width(&name, height) + px(MARGIN_MM));
        sheet.marks.push(mark);
        sheet.marks.push(font.line(&name, (at.into(), below), height, INK));
        sheet.check()?;
        Ok(Some(corner))
    }

    fn view(
        &self,
        side: Side,
        framing: &Framing,
        shot: &Shot,
        pixel: f64,
        round: u32,
    ) -> Result<Laid, RenderError> {
        let (back, up) = side.axes(framing);
        let size = extent(framing, &orthographic(framing, back, up, 1.0)) / pixel;
        if size.is_nan() || size.max_element() > 1e6 {
            return Err(RenderError::Usage(format!(
                "a picture of {:.0}×{:.0} pixels at this scale is too large; try a smaller one or fewer \
                 pixels in an inch",
                size.x, size.y
            )));
        }
        let [width, height] = size.to_array().map(|s| s.ceil() as u32 + 2 * round);
        let camera = orthographic(framing, back, up, f64::from(height) * pixel);
        let light = light(&camera);
        let shot = Shot { camera, light, background: glam::Vec3::ONE, ..*shot };
        Ok(Laid { side, view: PlacedView { shot, x: 0, y: 0, width, height } })
    }

    /// Bar, title and what else one has to know, below everything.
    fn add_footer(&self, sheet: &mut Sheet, font: &Font, pixel: f64, px: &dyn Fn(f64) -> u32) {
        let margin = px(MARGIN_MM);
        let room = sheet.width.saturating_sub(2 * margin);
        let mut y = sheet.height + px(GAP_MM) / 2;
        let most = px(BAR_MM).min(room);
        if let Some(bar) = ScaleBar::new(pixel, self.unit, most, None) {
            y += px(LABEL_MM) * 3 / 2;
            let at = (i64::from(margin), i64::from(y));
            sheet.marks.extend(bar.marks(font, at, f64::from(px(LABEL_MM)), INK));
            y += px(LABEL_MM);
        }
        let lines = [
            (TITLE_MM, self.title.clone()),
            (
                FOOTER_MM,
                format!(
                    "{} at {} dpi · unit of the scan: {}",
                    self.scale.name(),
                    self.scale.dpi,
                    self.unit.name()
                ),
            ),
            (FOOTER_MM, "parallel projection · light from the upper left, 45°".to_owned()),
            (FOOTER_MM, software()),
        ];
        for (height_mm, text) in lines {
            let height = f64::from(px(height_mm));
            let text = font.fitted(&text, height, room);
            let mark: Mark = font.line(&text, (margin.into(), y.into()), height, INK);
            sheet.marks.push(mark);
            y += px(height_mm) * 5 / 4;
        }
        sheet.height = y + margin;
    }
}

/// Places views: the row on its base line, top and bottom at the front's column. Returns where what is
/// placed ends to the right and below.
fn place(laid: &mut [Laid], margin: u32, gap: u32, label: u32) -> (u32, u32) {
    let height_of =
        |laid: &[Laid], side: Side| laid.iter().find(|l| l.side == side).map(|l| l.view.height);
    let above = height_of(laid, Side::Top).map_or(0, |h| h + label + gap);
    let row = [Side::Left, Side::Front, Side::Right, Side::Back];
    let in_row = |laid: &[Laid]| {
        let heights = laid.iter().filter(|l| row.contains(&l.side)).map(|l| l.view.height);
        heights.max().map_or(0, |h| h + label + gap)
    };
    let row_height = in_row(laid);
    let base = margin + above + row_height.saturating_sub(label + gap);
    let (mut x, mut column) = (margin, margin);
    for side in row {
        if side == Side::Front {
            column = x;
        }
        for l in laid.iter_mut().filter(|l| l.side == side) {
            (l.view.x, l.view.y) = (x, base - l.view.height);
            x += l.view.width + gap;
        }
    }
    for l in laid.iter_mut() {
        match l.side {
            Side::Top => (l.view.x, l.view.y) = (column, margin),
            Side::Bottom => (l.view.x, l.view.y) = (column, margin + above + row_height),
            _ => {}
        }
    }
    let right = laid.iter().map(|l| l.view.x + l.view.width).max().unwrap_or(margin);
    let bottom = laid.iter().map(|l| l.view.y + l.view.height + label).max().unwrap_or(margin);
    (right, bottom)
}
