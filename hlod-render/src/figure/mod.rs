//! Figures one may publish: pictures of a known scale and of any size, with what they were made from.
//!
//! A [`Sheet`] is a page with views, marks and nothing else. It is drawn in rows of parts and streamed to a
//! PNG or TIFF file ([`save`]), so that memory does not grow with its area; every part is, bit for bit,
//! what the whole picture has there. [`scale`] relates pixels to paper and to the statue; [`plate`],
//! [`turntable`] and [`light_dome`] are series and arrangements of views that figures usually need.

mod camera;
mod file;
mod font;
mod legend;
pub mod light_dome;
mod marks;
mod outline;
pub mod plate;
mod provenance;
pub mod scale;
mod scale_bar;
mod series;
mod sheet;
mod strips;
pub mod turntable;

pub use camera::{extent, fitting, orthographic};
pub use file::{Format, check_output, save};
pub use font::Font;
pub use legend::legend;
pub use marks::Mark;
pub use provenance::{Provenance, command_line};
pub use scale_bar::{ScaleBar, bar_for_plane};
pub use series::{Series, check_folder};
pub use sheet::{Drawn, PlacedView, Progress, Sheet};
