//! The clocks of the process and its memory, for the bench.

use cpu_time::ProcessTime;
use gltf_lod::bench::Instruments;
use peakmem_alloc::{PeakMemAlloc, PeakMemAllocTrait};
use std::alloc::System;
use std::time::{Duration, Instant};

/// The system's allocator, and how many bytes of it are in use: two additions for each call.
#[global_allocator]
static MEMORY: PeakMemAlloc<System> = PeakMemAlloc::system();

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

    fn peak_memory(&self, work: &mut dyn FnMut()) -> Option<u64> {
        MEMORY.reset_peak_memory();
        work();
        u64::try_from(MEMORY.get_peak_memory()).ok()
    }
}
