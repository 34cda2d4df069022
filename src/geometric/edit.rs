//! A node of a chain edited at another length than that at rest.

use super::chain::{Chain, ChainError, ChainShape};

/// Bisections of a radius: to the last bit.
const HALVINGS: u32 = 200;

/// Tolerance of a radius found, relative to the length at rest.
const ROUNDED: f64 = 1e-12;

impl ChainShape {
    /// The radius at rest of a node that has the radius `target` at a length, all in \[m\], with
    /// `insert` nodes between each two. The former increases with the latter.
    ///
    /// # Errors
    /// The least and the greatest permitted radius at this length \[m\]. A muscle thicker than twice its length is refused.
    pub fn radius_at_rest(
        &self,
        insert: usize,
        node: usize,
        length: f64,
        target: f64,
    ) -> Result<f64, [f64; 2]> {
        let rest = self.length;
        if !(target <= rest) {
            return Err([0.0, rest]);
        }
        if length == rest {
            return Ok(target);
        }
        let at = |radius: f64| self.radius_at(insert, node, length, radius);
        if let Ok(least) = at(0.0)
            && target < least
        {
            return Err([least, rest]);
        }
        let own = node * (insert + 1) + 1;
        let (mut low, mut high) = (0.0, 2.0 * rest);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            let is_thinner = match at(middle) {
                Ok(radius) => radius < target,
                Err(ChainError::TooLong { node, .. }) => node == own,
                Err(_) => false,
            };
            if is_thinner {
                low = middle
            } else {
                high = middle
            }
        }
        match at(high) {
            Ok(found) if (found - target).abs() <= ROUNDED * rest => Ok(high),
            Ok(found) => Err([0.0, found]),
            Err(_) => Err([0.0, rest]),
        }
    }

    /// The radius of a node at a length, for the radius `radius` at rest \[m\].
    fn radius_at(
        &self,
        insert: usize,
        node: usize,
        length: f64,
        radius: f64,
    ) -> Result<f64, ChainError> {
        let mut shape = self.clone();
        shape.radii[node] = radius;
        let mut chain = Chain::new(shape.refined(insert))?;
        chain.set_length(length)?;
        Ok(chain.radii()[node * (insert + 1)])
    }
}
