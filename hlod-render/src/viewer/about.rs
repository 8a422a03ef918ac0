//! What is known of the scan besides its shape, in the panel.

use egui::{RichText, Ui};
use hlod_compress::Metadata;

/// Lists what the file's metadata say; nothing where it has none.
pub fn show(ui: &mut Ui, metadata: Option<&Metadata>) {
    let Some(metadata) = metadata else { return };
    let title = RichText::new("About this scan").strong();
    egui::CollapsingHeader::new(title).default_open(false).show(ui, |ui| {
        for (name, text) in metadata.lines() {
            ui.label(RichText::new(name).weak().size(11.5));
            // Addresses are longer than the panel is wide.
            ui.add(egui::Label::new(text).wrap());
        }
        let more = metadata.unknown_keys().len();
        if more > 0 {
            let remark = format!("and {more} other keys: hlod-build info --json");
            ui.label(RichText::new(remark).weak().size(11.5));
        }
    });
}
