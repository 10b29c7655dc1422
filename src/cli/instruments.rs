//! The clocks of the process, for the bench.

use cpu_time::ProcessTime;
use gltf_lod::bench::Instruments;
use std::time::{Duration, Instant};

/// This process.
pub struct Process {
    wall: Instant,
    cpu: ProcessTime,
}

impl Process {
    /// Starts both clocks.
    pub fn start() -> Self {
        Self { wall: Instant::now(), cpu: ProcessTime::now() }
    }
}

impl Instruments for Process {
    fn wall(&self) -> Duration {
        self.wall.elapsed()
    }

    fn cpu(&self) -> Duration {
        self.cpu.elapsed()
    }
}
