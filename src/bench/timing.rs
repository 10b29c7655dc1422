//! The clock: ours and meshoptimizer's calls in turn, so that a busy machine slows all of them.
//!
//! Ours: from a plain mesh to all levels as plain meshes. Theirs: the library's calls alone, on prepared buffers.

use super::report::{RivalTime, Times};
use super::{Instruments, Mode};
use crate::baseline::{BareCalls, Prepared};
use crate::error::Result;
use crate::mesh::Mesh;
use crate::simplify::{self, simplify};
use std::time::Duration;

/// Rounds without a better minimum after which the minima count as settled.
const SETTLED: usize = 10;
/// A minimum is better if it is so by this share.
const BETTER: f64 = 0.01;
/// Time after which no further round starts, once there are [`FEWEST`].
const PATIENCE: Duration = Duration::from_secs(20);
const FEWEST: usize = 3;
/// Workers that ours has left idle look for work for some microseconds, on everybody's processor time.
const PAUSE: Duration = Duration::from_millis(1);

/// One mesh, and who runs on it.
pub(super) struct Race<'a> {
    pub source: &'a Mesh,
    pub options: &'a simplify::Options,
    pub prepared: &'a Prepared,
    pub modes: &'a [Mode],
    /// Triangles of each level.
    pub counts: &'a [usize],
}

/// Times of one competitor, one for each round.
#[derive(Default)]
struct Laps {
    cpu: Vec<Duration>,
    wall: Vec<Duration>,
}

impl Race<'_> {
    /// Times of ours and of each mode.
    pub fn run(&self, runs: Option<usize>, instruments: &dyn Instruments) -> Result<(Times, Vec<RivalTime>)> {
        let calls: Vec<BareCalls> =
            self.modes.iter().map(|mode| self.prepared.bare_calls(mode.settings)).collect::<Result<_>>()?;
        let mut ours = Laps::default();
        let mut theirs: Vec<Laps> = self.modes.iter().map(|_| Laps::default()).collect();
        let start = instruments.wall();
        let (mut rounds, mut last_better) = (0, 0);
        loop {
            let mut is_better = ours.time(instruments, || simplify(self.source, self.options))?;
            std::thread::sleep(PAUSE);
            for ((laps, calls), mode) in theirs.iter_mut().zip(&calls).zip(self.modes) {
                is_better |= laps.time(instruments, || Ok(self.run_calls(calls, *mode)))?;
            }
            rounds += 1;
            if is_better {
                last_better = rounds;
            }
            let is_enough = match runs {
                Some(runs) => rounds >= runs,
                None if rounds < FEWEST => false,
                None => rounds - last_better >= SETTLED || instruments.wall() - start > PATIENCE,
            };
            if is_enough {
                break;
            }
        }
        let name = |(mode, laps): (&Mode, Laps)| RivalTime { mode: *mode, times: laps.summarise() };
        Ok((ours.summarise(), self.modes.iter().zip(theirs).map(name).collect()))
    }

    fn run_calls(&self, calls: &BareCalls, mode: Mode) -> usize {
        if mode.chained {
            calls.run_chain(self.counts)
        } else {
            self.counts.iter().map(|&count| calls.run_chain(&[count])).sum()
        }
    }
}

impl Laps {
    /// Runs `work` once more; whether it was clearly faster than ever before. What it gives is dropped off the clock.
    fn time<T>(&mut self, instruments: &dyn Instruments, work: impl FnOnce() -> Result<T>) -> Result<bool> {
        let (cpu, wall) = (instruments.cpu(), instruments.wall());
        let result = work();
        let (wall, cpu) = (instruments.wall() - wall, instruments.cpu() - cpu);
        std::hint::black_box(result?);
        let is_better = |laps: &[Duration], lap: Duration| {
            laps.iter().min().is_none_or(|best| lap.as_secs_f64() < best.as_secs_f64() * (1.0 - BETTER))
        };
        let better = is_better(&self.cpu, cpu) || is_better(&self.wall, wall);
        self.cpu.push(cpu);
        self.wall.push(wall);
        Ok(better)
    }

    fn summarise(mut self) -> Times {
        let sort = |laps: &mut Vec<Duration>| -> [f64; 2] {
            laps.sort_unstable();
            let at = |index: usize| laps.get(index).map_or(0.0, Duration::as_secs_f64);
            [at(0), at(laps.len() / 2)]
        };
        let ([cpu, cpu_median], [wall, wall_median]) = (sort(&mut self.cpu), sort(&mut self.wall));
        Times { cpu, cpu_median, wall, wall_median, runs: self.cpu.len() }
    }
}
