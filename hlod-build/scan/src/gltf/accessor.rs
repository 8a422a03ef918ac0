//! Accessors: typed arrays within buffers, decoded a piece at a time.
//!
//! The glTF library's own iterators trust the document and panic where it lies, so
//! that only its JSON types are used; every range is checked here, once, when an
//! accessor is opened.

use ::gltf::json;
use json::accessor::{ComponentType, Type};
use json::validation::Checked;

use super::buffers::Buffers;
use crate::error::ScanError;

/// Most bytes read at once.
const READ_BYTES_MAX: u64 = 512 * 1024;

/// Largest stride that the format allows.
const STRIDE_BYTES_MAX: u64 = 252;

/// How integers become numbers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// As they are.
    Plain,
    /// The type's range becomes 0..=1, or −1..=1 if it is signed.
    Normalised,
    /// As the accessor says.
    AsDeclared,
}

/// A checked accessor.
pub(super) struct Accessor {
    /// Name for messages.
    pub(super) item: String,
    pub(super) count: u64,
    pub(super) component_count: usize,
    component: ComponentType,
    is_normalised: bool,
    data: Range,
    /// Items that replace those of the array: place and value, in order of place.
    replaced: Vec<(u64, [f64; 4])>,
}

/// Equally spaced items in a buffer.
struct Range {
    buffer: usize,
    offset: u64,
    stride: u64,
}

impl Accessor {
    /// Opens accessor `index`, whose items must have one of the `types`.
    pub(super) fn open(
        root: &json::Root,
        buffers: &mut Buffers,
        index: usize,
        types: &[Type],
        scale: Scale,
    ) -> Result<Accessor, ScanError> {
        let item = format!("accessors[{index}]");
        let malformed = |what: &str| ScanError::malformed(buffers.at(item.clone()), what);
        let Some(accessor) = root.accessors.get(index) else {
            return Err(malformed("there is no such accessor"));
        };
        let Checked::Valid(json::accessor::GenericComponentType(component)) =
            accessor.component_type
        else {
            return Err(malformed("its component type is unknown"));
        };
        let component_count = match accessor.type_ {
            Checked::Valid(found) if types.contains(&found) => match found {
                Type::Scalar => 1,
                Type::Vec2 => 2,
                Type::Vec3 => 3,
                _ => 4,
            },
            _ => return Err(malformed("its type does not suit its use")),
        };
        let Some(view) = accessor.buffer_view else {
            return Err(malformed(
                "it has no `bufferView`; if the document is compressed, export it without \
                 compression",
            ));
        };
        let is_normalised = match scale {
            Scale::Plain => false,
            Scale::Normalised => true,
            Scale::AsDeclared => accessor.normalized,
        };
        let count = accessor.count.0;
        let offset = accessor.byte_offset.unwrap_or_default().0;
        let item_bytes = (component.size() * component_count) as u64;
        let data = check_range(root, buffers, &item, (view.value(), offset), (count, item_bytes))?;
        let mut checked = Accessor {
            item,
            count,
            component_count,
            component,
            is_normalised,
            data,
            replaced: Vec::new(),
        };
        if let Some(sparse) = &accessor.sparse {
            checked.replaced = checked.read_sparse(root, buffers, sparse)?;
        }
        Ok(checked)
    }

    /// Reads `count` items from `begin` on into `out`, replacing its content. Missing
    /// components are 0.
    pub(super) fn read(
        &self,
        buffers: &mut Buffers,
        begin: u64,
        count: usize,
        out: &mut Vec<[f64; 4]>,
    ) -> Result<(), ScanError> {
        out.clear();
        let count = self.count.saturating_sub(begin).min(count as u64);
        self.read_range(buffers, &self.data, begin, count, out)?;
        let first = self.replaced.partition_point(|(place, _)| *place < begin);
        for (place, value) in &self.replaced[first..] {
            match out.get_mut((place - begin) as usize) {
                Some(item) => *item = *value,
                None => break,
            }
        }
        Ok(())
    }

    fn read_range(
        &self,
        buffers: &mut Buffers,
        range: &Range,
        begin: u64,
        count: u64,
        out: &mut Vec<[f64; 4]>,
    ) -> Result<(), ScanError> {
        let component_bytes = self.component.size();
        let item_bytes = component_bytes * self.component_count;
        let mut bytes = Vec::new();
        let mut done = 0;
        while done < count {
            // The last item ends with its data, not with its stride.
            let items = (count - done).min(READ_BYTES_MAX / range.stride).max(1);
            bytes.resize((items - 1) as usize * range.stride as usize + item_bytes, 0);
            let offset = range.offset + (begin + done) * range.stride;
            buffers.read(range.buffer, offset, &mut bytes)?;
            for item in bytes.chunks(range.stride as usize) {
                let mut numbers = [0.0; 4];
                let components = item[..item_bytes].chunks_exact(component_bytes);
                for (number, component) in numbers.iter_mut().zip(components) {
                    *number = decode(self.component, component, self.is_normalised);
                }
                out.push(numbers);
            }
            done += items;
        }
        Ok(())
    }

    fn read_sparse(
        &self,
        root: &json::Root,
        buffers: &mut Buffers,
        sparse: &json::accessor::sparse::Sparse,
    ) -> Result<Vec<(u64, [f64; 4])>, ScanError> {
        let item = format!("{}.sparse", self.item);
        let count = sparse.count.0;
        let Checked::Valid(json::accessor::IndexComponentType(component)) =
            sparse.indices.component_type
        else {
            let what = "the type of its indices is unknown";
            return Err(ScanError::malformed(buffers.at(item), what));
        };
        let view = (sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0);
        let places = Accessor {
            item: item.clone(),
            count,
            component_count: 1,
            component,
            is_normalised: false,
            data: check_range(root, buffers, &item, view, (count, component.size() as u64))?,
            replaced: Vec::new(),
        };
        let item_bytes = (self.component.size() * self.component_count) as u64;
        let view = (sparse.values.buffer_view.value(), sparse.values.byte_offset.0);
        let range = check_range(root, buffers, &item, view, (count, item_bytes))?;

        let Some(left) = buffers.sparse_items_left.checked_sub(count) else {
            return Err(ScanError::Unsupported {
                at: buffers.at(item),
                what: format!("a sparse accessor of {count} more items"),
                advice: "export without sparse accessors",
            });
        };
        buffers.sparse_items_left = left;
        let mut numbers = Vec::new();
        places.read_range(buffers, &places.data, 0, count, &mut numbers)?;
        let places: Vec<u64> = numbers.iter().map(|[place, ..]| *place as u64).collect();
        let is_ascending = places.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_ascending || places.last().is_some_and(|last| *last >= self.count) {
            let what = "its indices are not ascending or too large";
            return Err(ScanError::malformed(buffers.at(item), what));
        }
        let mut values = Vec::new();
        self.read_range(buffers, &range, 0, count, &mut values)?;
        Ok(places.into_iter().zip(values).collect())
    }
}

/// Checks that `count` items of `item_bytes` lie within their view, and that within
/// its buffer. `view` is a view's number and the offset in it.
fn check_range(
    root: &json::Root,
    buffers: &mut Buffers,
    item: &str,
    (view_index, offset): (usize, u64),
    (count, item_bytes): (u64, u64),
) -> Result<Range, ScanError> {
    let at = buffers.at(item);
    let malformed = |what: String| ScanError::malformed(at.clone(), what);
    let Some(view) = root.buffer_views.get(view_index) else {
        return Err(malformed(format!("there is no bufferViews[{view_index}]")));
    };
    let buffer = view.buffer.value();
    let buffer_bytes = buffers.open(root, buffer)?;
    let view_begin = view.byte_offset.unwrap_or_default().0;
    let view_end = view_begin.checked_add(view.byte_length.0);
    if view_end.is_none_or(|end| end > buffer_bytes) {
        let what = format!("bufferViews[{view_index}] does not lie within buffers[{buffer}]");
        return Err(malformed(what));
    }
    let stride = view.byte_stride.map_or(item_bytes, |stride| stride.0 as u64);
    if stride < item_bytes || stride > STRIDE_BYTES_MAX {
        let what = format!("bufferViews[{view_index}] has a stride of {stride} bytes");
        return Err(malformed(what));
    }
    // The last item need not be followed by the rest of its stride.
    let room_bytes = view.byte_length.0.saturating_sub(offset);
    let possible = match room_bytes.checked_sub(item_bytes) {
        Some(rest) => rest / stride + 1,
        None => 0,
    };
    if count > possible {
        return Err(ScanError::CountTooLarge {
            at,
            what: "items".to_owned(),
            declared: count,
            possible,
        });
    }
    Ok(Range { buffer, offset: view_begin.saturating_add(offset), stride })
}

fn decode(component: ComponentType, bytes: &[u8], is_normalised: bool) -> f64 {
    let mut low = [0u8; 4];
    low[..bytes.len()].copy_from_slice(bytes);
    let bits = u32::from_le_bytes(low);
    let (value, largest) = match component {
        ComponentType::I8 => (f64::from(bits as i8), 127.0),
        ComponentType::U8 => (f64::from(bits as u8), 255.0),
        ComponentType::I16 => (f64::from(bits as i16), 32767.0),
        ComponentType::U16 => (f64::from(bits as u16), 65535.0),
        ComponentType::U32 => (f64::from(bits), f64::from(u32::MAX)),
        ComponentType::F32 => return f64::from(f32::from_bits(bits)),
    };
    if is_normalised {
        // The most negative number is one step below −1.
        (value / largest).max(-1.0)
    } else {
        value
    }
}
