//! The one loop that brings a body to rest, and the one test for it. Solvers, spring systems, skin
//! and fibres use them.

/// How the loop ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The body is at rest.
    Rest,
    /// The body is not at rest after the greatest number of steps.
    Steps,
    /// The observer stopped the loop.
    Stopped,
    /// No step brings the body nearer to rest.
    Stuck,
}

/// A body that approaches rest step by step.
///
/// ```
/// use pliant::testing::internals::rest::{End, Relax, all_within, relax};
/// use std::convert::Infallible;
///
/// /// The root of 2 by Newton's method.
/// struct Root {
///     x: f64,
///     steps: usize,
/// }
///
/// impl Relax for Root {
///     type Error = Infallible;
///     fn judge(&mut self) -> Result<bool, Infallible> {
///         Ok(all_within([((self.x * self.x - 2.0).abs(), 1e-12)]))
///     }
///     fn steps(&self) -> usize {
///         self.steps
///     }
///     fn advance(&mut self) -> Result<bool, Infallible> {
///         self.x = 0.5 * (self.x + 2.0 / self.x);
///         self.steps += 1;
///         Ok(true)
///     }
/// }
///
/// let mut root = Root { x: 1.0, steps: 0 };
/// assert_eq!(relax(&mut root, 10, |_| true), Ok(End::Rest));
/// assert_eq!(root.steps, 5);
/// ```
pub trait Relax {
    /// Failure of a step.
    type Error;

    /// Measures the present state and returns whether it counts as rest; see [`all_within`].
    ///
    /// # Errors
    /// The state cannot be measured.
    fn judge(&mut self) -> Result<bool, Self::Error>;

    /// Steps so far.
    fn steps(&self) -> usize;

    /// Makes one step. Returns false if no step brings the body nearer to rest.
    ///
    /// # Errors
    /// The step failed.
    fn advance(&mut self) -> Result<bool, Self::Error>;
}

/// Makes steps until `body` is at rest, at most `limit`. `watch` sees each state, including the
/// first, and returns whether to continue.
///
/// # Errors
/// A step failed.
pub fn relax<R: Relax>(
    body: &mut R,
    limit: usize,
    mut watch: impl FnMut(&R) -> bool,
) -> Result<End, R::Error> {
    loop {
        let at_rest = body.judge()?;
        let more = watch(body);
        if at_rest {
            return Ok(End::Rest);
        }
        if body.steps() >= limit {
            return Ok(End::Steps);
        }
        if !more {
            return Ok(End::Stopped);
        }
        if !body.advance()? {
            return Ok(End::Stuck);
        }
    }
}

/// Whether each measure is within its limit. A NaN is never within its limit.
pub fn all_within<const N: usize>(measures: [(f64, f64); N]) -> bool {
    measures.iter().all(|(value, limit)| value <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A number that each step halves, down to a least value.
    struct Halved {
        value: f64,
        least: f64,
        steps: usize,
    }

    impl Relax for Halved {
        type Error = ();
        fn judge(&mut self) -> Result<bool, ()> {
            Ok(all_within([(self.value, 1.0)]))
        }
        fn steps(&self) -> usize {
            self.steps
        }
        fn advance(&mut self) -> Result<bool, ()> {
            if self.value.is_infinite() {
                return Err(());
            }
            self.value *= 0.5;
            self.steps += 1;
            Ok(self.value >= self.least)
        }
    }

    fn halved(value: f64, least: f64, limit: usize) -> (Result<End, ()>, usize, usize) {
        let mut body = Halved {
            value,
            least,
            steps: 0,
        };
        let mut seen = 0;
        let end = relax(&mut body, limit, |body| {
            seen += 1;
            body.value < 1000.0
        });
        (end, body.steps, seen)
    }

    #[test]
    fn it_ends_at_rest_at_the_limit_when_stopped_when_stuck_or_failed() {
        assert_eq!(halved(8.0, 0.0, 9), (Ok(End::Rest), 3, 4));
        assert_eq!(halved(1.0, 0.0, 9), (Ok(End::Rest), 0, 1));
        assert_eq!(halved(8.0, 0.0, 2), (Ok(End::Steps), 2, 3));
        assert_eq!(halved(4000.0, 0.0, 9), (Ok(End::Stopped), 0, 1));
        assert_eq!(halved(8.0, 3.0, 9), (Ok(End::Stuck), 2, 2));
        assert_eq!(halved(f64::INFINITY, 0.0, 9).0, Ok(End::Stopped));
        let failed = relax(
            &mut Halved {
                value: f64::INFINITY,
                least: 0.0,
                steps: 0,
            },
            9,
            |_| true,
        );
        assert_eq!(failed, Err(()));
    }

    #[test]
    fn what_is_not_a_number_is_not_at_rest() {
        assert!(all_within([(0.5, 1.0), (1.0, 1.0)]));
        assert!(!all_within([(0.5, 1.0), (1.5, 1.0)]) && !all_within([(f64::NAN, 1.0)]));
    }
}
