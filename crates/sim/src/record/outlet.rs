//! Bytes on their way into a file: an outlet keeps what the disk did not take, in order.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::RecordError;

/// Where the bytes of a recording go.
pub trait Sink: Write + Send {
    /// Waits until the bytes are on the disk.
    ///
    /// # Errors
    /// Those of the operating system.
    fn sync(&mut self) -> io::Result<()>;
}

impl Sink for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_all()
    }
}

impl Sink for Vec<u8> {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A sink, and the bytes that it has not taken yet.
pub(super) struct Outlet<W> {
    pub(super) sink: W,
    pub(super) path: PathBuf,
    pub(super) pending: Vec<u8>,
    written: usize,
}

impl Outlet<File> {
    pub(super) fn create(path: &Path) -> Result<Self, RecordError> {
        let file = File::create(path).map_err(|source| RecordError::io(path, source))?;
        Ok(Self::new(file, path))
    }
}

impl<W: Sink> Outlet<W> {
    pub(super) fn new(sink: W, path: &Path) -> Self {
        Self {
            sink,
            path: path.to_owned(),
            pending: Vec::new(),
            written: 0,
        }
    }

    /// Writes all pending bytes; after an error the next call goes on where this one stopped.
    pub(super) fn drain(&mut self) -> Result<(), RecordError> {
        while self.written < self.pending.len() {
            match self.sink.write(&self.pending[self.written..]) {
                Ok(0) => return Err(self.fault(io::ErrorKind::WriteZero.into())),
                Ok(count) => self.written += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.fault(error)),
            }
        }
        self.pending.clear();
        self.written = 0;
        Ok(())
    }

    /// Writes all pending bytes and waits until the disk has them.
    pub(super) fn close(&mut self) -> Result<(), RecordError> {
        self.drain()?;
        let synced = self.sink.flush().and_then(|()| self.sink.sync());
        synced.map_err(|error| self.fault(error))
    }

    pub(super) fn refused(&self, reason: String) -> RecordError {
        RecordError::refused(&self.path, reason)
    }

    fn fault(&self, source: io::Error) -> RecordError {
        RecordError::io(&self.path, source)
    }
}
