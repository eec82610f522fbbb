//! Several parameter vectors beside one another in the lanes of a vector, and what takes what a simulation shows.

use crate::numerics::real::{Carries, Real, Several};
use std::marker::PhantomData;

/// Numbers beside one another at most.
pub(super) const LANES: usize = 8;

/// Parameter vectors of one length beside one another; places left over repeat the last.
#[inline(always)]
pub(super) fn beside<T: Real, W: Several<T>>(forms: &[Vec<T>]) -> Vec<W> {
    let mut p = Vec::with_capacity(forms[0].len());
    for k in 0..forms[0].len() {
        let mut lanes = [T::zero(); LANES];
        for (lane, x) in lanes.iter_mut().enumerate() {
            *x = forms[lane.min(forms.len() - 1)][k];
        }
        p.push(W::of(&lanes));
    }
    p
}

/// What takes the `C` quantities that a simulation shows at sample `k` of window `number`. A type of its own insists on being inlined,
/// which a closure does not.
pub(super) trait Sink<W, const C: usize> {
    fn take(&mut self, number: usize, k: usize, shown: [W; C]);
}

/// Hands them on.
pub(super) struct One<T, S>(S, PhantomData<T>);

impl<T, S> One<T, S> {
    pub(super) fn new<const C: usize>(sink: S) -> Self
    where
        S: FnMut(usize, usize, [T; C]),
    {
        Self(sink, PhantomData)
    }
}

impl<T: Real, W: Carries<T>, S: FnMut(usize, usize, [T; C]), const C: usize> Sink<W, C> for One<T, S> {
    #[inline(always)]
    fn take(&mut self, number: usize, k: usize, shown: [W; C]) {
        let mut own = [T::zero(); C];
        for c in 0..C {
            own[c] = shown[c].give();
        }
        (self.0)(number, k, own);
    }
}

/// Hands on what the first `count` places show, with the number of the form in place of that of the window.
pub(super) struct Each<'s, T, S> {
    sink: &'s mut S,
    first: usize,
    count: usize,
    number: PhantomData<T>,
}

impl<'s, T, S> Each<'s, T, S> {
    /// Of forms from number `first` on.
    pub(super) fn new<const C: usize>(sink: &'s mut S, first: usize, count: usize) -> Self
    where
        S: FnMut(usize, usize, [T; C]),
    {
        Self { sink, first, count, number: PhantomData }
    }
}

impl<T: Real, W: Several<T>, S: FnMut(usize, usize, [T; C]), const C: usize> Sink<W, C> for Each<'_, T, S> {
    #[inline(always)]
    fn take(&mut self, _: usize, k: usize, shown: [W; C]) {
        let mut lanes = [[T::zero(); LANES]; C];
        for c in 0..C {
            shown[c].put(&mut lanes[c]);
        }
        for lane in 0..self.count {
            let mut own = [T::zero(); C];
            for c in 0..C {
                own[c] = lanes[c][lane];
            }
            (self.sink)(self.first + lane, k, own);
        }
    }
}
