//! Pages that are drawn in parts.

use crate::error::RenderError;
use crate::frame::Renderer;
use crate::gpu::Gpu;
use crate::model::Model;
use crate::passes::Window;
use crate::picture::{Canvas, PICTURE_FORMAT};
use crate::scene::{Enhance, Shadow, Shot};
use crate::shadow_map::MapCount;
use crate::survey::Survey;

use super::marks::Mark;

/// Samples of one part at most: 4 million, which take 32 bytes each on the GPU and with shadows twice that.
const PART_SAMPLES: u64 = 1 << 22;
/// Bytes of the rows that are in memory at a time.
const ROWS_BYTES: u64 = 64 << 20;
/// Pages of more pixels a side are refused: so many are 5.5 m at 300 pixels an inch.
const SIDE_MAX: u32 = 65_536;
/// Samples a side, beyond which positions in f32 are coarser than a sixteenth of one.
const SAMPLES_MAX: u32 = 1 << 18;

/// A view on a page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedView {
    /// What is seen.
    pub shot: Shot,
    /// Left side in pixels of the page.
    pub x: u32,
    /// Upper side.
    pub y: u32,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A page.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour where nothing else is, sRGB; views bring their own background.
    pub paper: [u8; 3],
    /// Leaves what nothing is drawn on transparent, in views as well.
    pub transparent: bool,
    /// Views; later ones lie over earlier ones.
    pub views: Vec<PlacedView>,
    /// What is laid over them.
    pub marks: Vec<Mark>,
    /// Samples of a pixel along each side.
    pub supersampling: u32,
    /// Parts are no larger than so many pixels a side, where that is less than there is room for.
    pub part_px: Option<u32>,
}

/// What was drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Drawn {
    /// Parts that the page was drawn in.
    pub parts: u64,
    /// Triangles that its views show.
    pub triangles: u64,
    /// Points that they show at most.
    pub points: u64,
    /// Nodes of the octree.
    pub nodes: u64,
    /// Triangles and points that cast shadows on these.
    pub caster_triangles: u64,
    /// Nodes that do.
    pub caster_nodes: u64,
    /// What came of shadow maps, where there were any.
    pub maps: MapCount,
}

/// Told how many of all rows are done.
pub type Progress<'a> = dyn FnMut(u32, u32) + 'a;

/// Takes rows, four bytes a pixel, from the upper side on.
pub(super) type Rows<'a> = dyn FnMut(&[u8]) -> Result<(), RenderError> + 'a;

impl Sheet {
    /// A page that is one view, and has its background.
    pub fn of(shot: &Shot, width: u32, height: u32) -> Sheet {
        let paper = shot.background.to_array().map(hlod_compress::srgb::srgb_from_linear);
        Sheet {
            width,
            height,
            paper,
            transparent: false,
            views: vec![PlacedView { shot: *shot, x: 0, y: 0, width, height }],
            marks: Vec::new(),
            supersampling: 1,
            part_px: None,
        }
    }

    /// # Errors
    /// When the page is larger than can be drawn.
    pub fn check(&self) -> Result<(), RenderError> {
        check_size(self.width, self.height, self.supersampling)
    }

    /// How many rows are drawn at a time.
    pub fn rows_at_once(&self) -> u32 {
        let samples = u64::from(self.supersampling.max(1)).pow(2);
        // Parts are about square where pages are not too wide for that.
        let side = ((PART_SAMPLES / samples) as f64).sqrt() as u64;
        let rows = (ROWS_BYTES / (4 * u64::from(self.width.max(1)))).min(side).max(1) as u32;
        rows.min(self.part_px.unwrap_or(rows)).clamp(1, self.height.max(1))
    }

    fn part_width(&self, gpu: &Gpu, rows: u32) -> u32 {
        let n = self.supersampling.max(1);
        let samples = PART_SAMPLES / (u64::from(n) * u64::from(n) * u64::from(rows));
        let limit = gpu.device.limits().max_texture_dimension_2d / n - 2 * MARGIN_MAX;
        let widest = self.views.iter().map(|v| v.width).max().unwrap_or(1);
        let width = (samples as u32).min(limit).min(widest);
        width.min(self.part_px.unwrap_or(width)).max(1)
    }

    /// Draws the page, row of parts by row of parts, after loading what each needs.
    ///
    /// # Errors
    /// When the page is too large, the GPU fails, or the rows cannot be taken.
    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        models: &mut [Model],
        take: &mut Rows<'_>,
        progress: &mut Progress<'_>,
    ) -> Result<Drawn, RenderError> {
        self.check()?;
        let n = self.supersampling.max(1);
        let mut drawn = Drawn::default();
        let mut surveys = Vec::new();
        for view in &self.views {
            // The page's own pixels decide what is fine enough.
            let size = (view.width * n, view.height * n);
            let survey = Survey::new(gpu, models, &view.shot.finer(n), size)?;
            drawn.add(&survey);
            surveys.push(survey);
        }
        let at_once = self.rows_at_once();
        let part = (self.part_width(gpu, at_once), at_once);
        self.check_maps(part)?;
        // What pixels depend on beyond the part that they are in is drawn as well.
        let reach = |v: &PlacedView| v.shot.finer(n).reach_px().div_ceil(n);
        let margin = self.views.iter().map(reach).max().unwrap_or(0);
        let drawn_at_once = |side: u32| (side + 2 * margin) * n;
        let mut brush = Brush {
            gpu,
            canvas: Canvas::new(gpu, drawn_at_once(part.0), drawn_at_once(part.1))?,
            renderer: Renderer::new(gpu, PICTURE_FORMAT),
            part,
            margin,
            n,
            transparent: self.transparent,
        };
        for first in (0..self.height).step_by(at_once as usize) {
            let count = at_once.min(self.height - first);
            let mut rows = self.blank(count);
            for (view, survey) in self.views.iter().zip(&surveys) {
                drawn.parts += brush.paint(models, view, survey, (first, count), &mut rows)?;
                if matches!(view.shot.shadow, Shadow::Mapped(_)) {
                    drawn.maps.add(brush.renderer.map_count(gpu)?);
                }
            }
            for mark in &self.marks {
                mark.draw(&mut rows.rgba, self.width, first);
            }
            take(&rows.rgba)?;
            progress(first + count, self.height);
        }
        Ok(drawn)
    }

    /// Shadow maps are fitted to what one drawing shows: parts of a picture would have different ones.
    fn check_maps(&self, part: (u32, u32)) -> Result<(), RenderError> {
        let in_parts = |v: &PlacedView| v.width > part.0 || v.y + v.height > part.1;
        let mapped = |v: &&PlacedView| matches!(v.shot.shadow, Shadow::Mapped(_));
        match self.views.iter().filter(mapped).find(|v| in_parts(v)) {
            None => Ok(()),
            Some(view) => Err(RenderError::Usage(format!(
                "a picture of {}×{} pixels with {n}×{n} samples each is drawn in parts, and each would have a \
                 shadow map of its own; try --shadow hard, or a smaller picture",
                view.width,
                view.height,
                n = self.supersampling.max(1),
            ))),
        }
    }

    /// The page as one picture in memory.
    ///
    /// # Errors
    /// When the page is too large or the GPU fails.
    pub fn picture(
        &self,
        gpu: &Gpu,
        models: &mut [Model],
    ) -> Result<crate::picture::Picture, RenderError> {
        let mut rgba = Vec::new();
        let mut take = |rows: &[u8]| {
            rgba.extend_from_slice(rows);
            Ok(())
        };
        self.draw(gpu, models, &mut take, &mut |_, _| {})?;
        Ok(crate::picture::Picture { width: self.width, height: self.height, rgba })
    }

    fn blank(&self, count: u32) -> PageRows {
        let [r, g, b] = self.paper;
        let pixel = if self.transparent { [0; 4] } else { [r, g, b, 255] };
        let rgba = pixel.repeat(self.width as usize * count as usize);
        PageRows { rgba, width: self.width }
    }
}

impl Drawn {
    fn add(&mut self, survey: &Survey) {
        self.triangles += survey.triangles;
        self.points += survey.points;
        self.nodes += survey.nodes;
        self.caster_triangles += survey.caster_triangles;
        self.caster_nodes += survey.caster_nodes;
    }
}

/// # Errors
/// When a page of this size cannot be drawn.
pub(super) fn check_size(width: u32, height: u32, supersampling: u32) -> Result<(), RenderError> {
    let n = supersampling.max(1);
    let most = SIDE_MAX.min(SAMPLES_MAX / n);
    if (1..=most).contains(&width) && (1..=most).contains(&height) {
        return Ok(());
    }
    Err(RenderError::Usage(format!(
        "a picture of {width}×{height} pixels: with {n}×{n} samples a pixel 1 to {most} a side can be drawn"
    )))
}

/// Some of a page's rows.
struct PageRows {
    rgba: Vec<u8>,
    width: u32,
}

/// What parts are drawn with.
struct Brush<'a> {
    gpu: &'a Gpu,
    canvas: Canvas,
    renderer: Renderer,
    /// Pixels in a part's row, and its rows.
    part: (u32, u32),
    /// Pixels round it that are drawn and not kept.
    margin: u32,
    n: u32,
    transparent: bool,
}

/// More than any picture needs: see [`Shot::reach_px`].
const MARGIN_MAX: u32 = Enhance::RADIUS_MAX_PX as u32 + 2;

impl Brush<'_> {
    /// Draws what of a view lies in some of the page's rows; in how many parts.
    fn paint(
        &mut self,
        models: &mut [Model],
        view: &PlacedView,
        survey: &Survey,
        (first, count): (u32, u32),
        rows: &mut PageRows,
    ) -> Result<u64, RenderError> {
        let (top, bottom) = (first.max(view.y), (first + count).min(view.y + view.height));
        if top >= bottom {
            return Ok(0);
        }
        let n = self.n;
        let shot = view.shot.finer(n);
        let mut parts = 0;
        for x in (0..view.width).step_by(self.part.0 as usize) {
            // Where the picture begins there is nothing before it.
            let (left, above) = (self.margin.min(x), self.margin.min(top - view.y));
            self.canvas.targets.show(Window {
                picture_width: view.width * n,
                picture_height: view.height * n,
                x: (x - left) * n,
                y: (top - view.y - above) * n,
                is_part: true,
                transparent: self.transparent,
            });
            let targets = &self.canvas.targets;
            self.renderer.render_part(self.gpu, models, &shot, targets, survey)?;
            let picture = self.canvas.picture(self.gpu)?.reduced(n);
            let pixels = 4 * self.part.0.min(view.width - x) as usize;
            for y in top..bottom {
                let row = (y - top + above) as usize;
                let from = 4 * (row * picture.width as usize + left as usize);
                let to = (y - first) as usize * rows.width as usize + (view.x + x) as usize;
                rows.rgba[4 * to..4 * to + pixels]
                    .copy_from_slice(&picture.rgba[from..from + pixels]);
            }
            parts += 1;
        }
        Ok(parts)
    }
}
