//! Worlds as bytes, to be saved and to go on.

use super::{RestoreError, Roster, Slot, World};

impl World {
    /// The whole state as bytes, at any tick.
    pub fn save(&self) -> Vec<u8> {
        let mut bytes = self.tick.to_le_bytes().to_vec();
        crate::block::save_numbers(&self.row, &mut bytes);
        let active = |roster: &Roster| [roster.active as u8, roster.model as u8];
        bytes.extend(self.rosters.iter().flat_map(active));
        let told = serde_json::to_vec(&(&self.swapped, &self.failures));
        save_text(&told.expect("plain data"), &mut bytes);
        for slot in self.slots() {
            slot.block.save(&mut bytes);
        }
        for referee in &self.referees {
            let judge = serde_json::to_vec(&referee.judge(0)).expect("a judge is plain data");
            save_text(&judge, &mut bytes);
        }
        bytes
    }

    /// Takes back a state saved by a world of the same scenario and version.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), RestoreError> {
        self.try_restore(bytes).ok_or(RestoreError)
    }

    fn try_restore(&mut self, bytes: &[u8]) -> Option<()> {
        let tick = u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
        let mut at = 8;
        at += crate::block::restore_numbers(&mut self.row, &bytes[at..])?;
        for (robot, roster) in self.rosters.iter_mut().enumerate() {
            let [active, model] = bytes.get(at..)?.first_chunk()?;
            roster.active = usize::from(*active);
            roster.model = usize::from(*model);
            at += 2;
            if roster.active >= roster.names.len().max(1) || roster.model >= roster.models.len() {
                return None;
            }
            let moves = |slot: &Slot<f64>| slot.robot == robot && slot.models & (1 << model) != 0;
            self.driving[robot] = self.plants.iter().position(moves)?;
        }
        let told = saved_text(bytes.get(at..)?)?;
        (self.swapped, self.failures) = serde_json::from_slice(told).ok()?;
        at += 8 + told.len();
        let slots = self
            .sensors
            .iter_mut()
            .chain(&mut self.controllers)
            .chain(&mut self.plants);
        for slot in slots {
            at += slot.block.restore(bytes.get(at..)?)?;
        }
        for referee in &mut self.referees {
            let judge = saved_text(bytes.get(at..)?)?;
            referee.resume(serde_json::from_slice(judge).ok()?);
            at += 8 + judge.len();
        }
        // What this world would have told of its own begin is not told.
        self.events.clear();
        self.ticks[0] = tick;
        self.set_running(0, true);
        self.has_decided = true;
        self.seek(tick);
        (at == bytes.len()).then_some(())
    }

    fn slots(&self) -> impl Iterator<Item = &Slot<f64>> {
        self.sensors
            .iter()
            .chain(&self.controllers)
            .chain(&self.plants)
    }
}

/// Appends a text with its length.
fn save_text(text: &[u8], bytes: &mut Vec<u8>) {
    bytes.extend_from_slice(&(text.len() as u64).to_le_bytes());
    bytes.extend_from_slice(text);
}

/// A text that was saved at the front of these bytes.
fn saved_text(bytes: &[u8]) -> Option<&[u8]> {
    let (size, rest) = bytes.split_first_chunk()?;
    rest.get(..usize::try_from(u64::from_le_bytes(*size)).ok()?)
}
