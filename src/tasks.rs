//! Work on long arrays, by all threads where that is worth waking them.

use rayon::prelude::*;

/// Items that one thread takes at a time.
const TASK: usize = 4096;
/// Items from which on several threads are worth waking: fewer fit the caches of one.
const MANY: usize = 32 * TASK;

/// Works on all `items`, some at a time: `work` gets the index of the first one, and them. What it does to one must not depend on which come with it.
pub(crate) fn for_some<T: Send>(items: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    if items.len() < MANY {
        work(0, items);
    } else {
        items.par_chunks_mut(TASK).enumerate().for_each(|(task, items)| work(task * TASK, items));
    }
}

/// Works on each of `items`, which `work` gets with its index.
pub(crate) fn for_each<T: Send>(items: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    for_some(items, |first, items| items.iter_mut().enumerate().for_each(|(i, item)| work(first + i, item)));
}

/// Reads all of `items` once, in order, which memory is fast at: then they are in the caches, if they fit.
pub(crate) fn read_through<T: Copy>(items: &[T]) {
    const LINE: usize = 64;
    let each_line = items.iter().step_by((LINE / size_of::<T>().max(1)).max(1));
    each_line.for_each(|item| {
        std::hint::black_box(*item);
    });
}

/// Does two things, together where there is as much to each of them as so many items.
pub(crate) fn join<A: Send, B: Send>(
    items: usize,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    if items < MANY { (first(), second()) } else { rayon::join(first, second) }
}

/// What `make` gives for 0 to `count`.
pub(crate) fn collect<T: Send + Clone + Default>(count: usize, make: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut items = vec![T::default(); count];
    for_each(&mut items, |i, item| *item = make(i));
    items
}
