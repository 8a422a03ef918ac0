//! Arrays that may be longer than memory: blocks of them are in memory, the others in a file.
//!
//! What a scan's faces name is mostly what the faces before named: the blocks touched last serve
//! nearly every access.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use bytemuck::Pod;

/// How much memory a reader may take for what it must remember, and where the rest goes.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    pub(crate) bytes: usize,
    /// A folder; all stays in memory without one.
    pub(crate) scratch: Option<PathBuf>,
}

impl Room {
    pub(crate) const UNBOUNDED: Room = Room { bytes: usize::MAX, scratch: None };

    /// One of `count` equal parts of the room.
    pub(crate) fn part(&self, count: usize) -> Room {
        Room { bytes: self.bytes / count, scratch: self.scratch.clone() }
    }
}

/// Items of one block.
const BLOCK: usize = 4096;
const NONE: u32 = u32::MAX;

/// A growing array of plain records.
pub(crate) struct Paged<T> {
    length: usize,
    blocks: Vec<Block<T>>,
    /// Which of `blocks` holds each block of the array, or [`NONE`].
    place_of: Vec<u32>,
    blocks_max: usize,
    /// Where the search for a block to put away goes on.
    hand: usize,
    scratch: Option<PathBuf>,
    file: Option<File>,
}

struct Block<T> {
    number: usize,
    items: Vec<T>,
    is_changed: bool,
    /// Touched since the hand last passed (the clock of F. J. Corbató, 1968).
    is_touched: bool,
}

impl<T: Pod> Paged<T> {
    pub(crate) fn new(room: &Room) -> Paged<T> {
        let blocks_max = match room.scratch {
            Some(_) => (room.bytes / (BLOCK * size_of::<T>())).max(4),
            None => usize::MAX,
        };
        Paged {
            length: 0,
            blocks: Vec::new(),
            place_of: Vec::new(),
            blocks_max,
            hand: 0,
            scratch: room.scratch.clone(),
            file: None,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.length
    }

    pub(crate) fn push(&mut self, item: T) -> io::Result<()> {
        let index = self.length;
        self.length += 1;
        *self.at(index)? = item;
        Ok(())
    }

    /// # Panics
    /// When `index` is not below the length.
    pub(crate) fn get(&mut self, index: usize) -> io::Result<T> {
        assert!(index < self.length, "index {index} of {}", self.length);
        let place = self.place(index / BLOCK)?;
        let block = &mut self.blocks[place];
        block.is_touched = true;
        Ok(block.items[index % BLOCK])
    }

    /// An item to be changed.
    ///
    /// # Panics
    /// When `index` is not below the length.
    pub(crate) fn at(&mut self, index: usize) -> io::Result<&mut T> {
        assert!(index < self.length, "index {index} of {}", self.length);
        let place = self.place(index / BLOCK)?;
        let block = &mut self.blocks[place];
        (block.is_touched, block.is_changed) = (true, true);
        Ok(&mut block.items[index % BLOCK])
    }

    /// The place in memory of a block, which is fetched where it has none.
    #[inline]
    fn place(&mut self, number: usize) -> io::Result<usize> {
        match self.place_of.get(number) {
            Some(&place) if place != NONE => Ok(place as usize),
            known => {
                let is_new = known.is_none();
                self.fetch(number, is_new)
            }
        }
    }

    #[cold]
    fn fetch(&mut self, number: usize, is_new: bool) -> io::Result<usize> {
        let place = if self.blocks.len() < self.blocks_max {
            let items = vec![T::zeroed(); BLOCK];
            self.blocks.push(Block { number, items, is_changed: false, is_touched: true });
            self.blocks.len() - 1
        } else {
            let place = self.put_away_one()?;
            self.blocks[place].number = number;
            place
        };
        let block = &mut self.blocks[place];
        block.is_changed = is_new;
        if is_new {
            block.items.fill(T::zeroed());
            self.place_of.resize(number + 1, NONE);
        } else if let Some(file) = &mut self.file {
            file.seek(SeekFrom::Start(offset_of::<T>(number)))?;
            file.read_exact(bytemuck::cast_slice_mut(&mut block.items))?;
        }
        self.place_of[number] = place as u32;
        Ok(place)
    }

    /// Writes a block that was not touched lately, if it was changed, and gives its place.
    fn put_away_one(&mut self) -> io::Result<usize> {
        loop {
            self.hand = (self.hand + 1) % self.blocks.len();
            let block = &mut self.blocks[self.hand];
            if !std::mem::take(&mut block.is_touched) {
                break;
            }
        }
        let block = &mut self.blocks[self.hand];
        if block.is_changed {
            let file = match &mut self.file {
                Some(file) => file,
                none => {
                    let folder = self.scratch.as_deref().unwrap_or(Path::new("."));
                    none.insert(tempfile::tempfile_in(folder)?)
                }
            };
            file.seek(SeekFrom::Start(offset_of::<T>(block.number)))?;
            file.write_all(bytemuck::cast_slice(&block.items))?;
            block.is_changed = false;
        }
        self.place_of[block.number] = NONE;
        Ok(self.hand)
    }
}

fn offset_of<T>(block: usize) -> u64 {
    (block * BLOCK * size_of::<T>()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_an_array_in_any_room() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Some(folder.path().to_owned());
        for room in [Room { bytes: 0, scratch }, Room::UNBOUNDED] {
            let (mut paged, mut plain) = (Paged::<[u32; 3]>::new(&room), Vec::new());
            for i in 0..(9 * BLOCK + 77) as u32 {
                paged.push([i, i ^ 5, 3 * i]).unwrap();
                plain.push([i, i ^ 5, 3 * i]);
            }
            let mut state = 1u64;
            for round in 0..200_000u32 {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let index = (state >> 33) as usize % plain.len();
                assert_eq!(paged.get(index).unwrap(), plain[index]);
                if round % 3 == 0 {
                    paged.at(index).unwrap()[1] += round;
                    plain[index][1] += round;
                }
            }
            assert_eq!(paged.len(), plain.len());
            for (i, item) in plain.iter().enumerate() {
                assert_eq!(paged.get(i).unwrap(), *item);
            }
            assert!(room.scratch.is_none() || paged.blocks.len() == 4);
        }
        // Nothing stays behind.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
