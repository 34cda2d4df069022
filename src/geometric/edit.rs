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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometric::chain::Caps;

    fn shape() -> ChainShape {
        ChainShape {
            radii: vec![0.01, 0.03, 0.04, 0.02, 0.008],
            growth: vec![0.0, 1.0, 1.5, 1.0, 0.0],
            length: 0.2,
            caps: Caps::Out,
        }
    }

    #[test]
    fn a_radius_at_rest_becomes_the_one_that_was_asked_for() {
        let shape = shape();
        for (insert, node, length) in [
            (0, 1, 0.16),
            (0, 2, 0.22),
            (2, 2, 0.17),
            (3, 3, 0.21),
            (1, 2, 0.2),
        ] {
            for target in [0.015, 0.031] {
                let rest = shape.radius_at_rest(insert, node, length, target);
                let rest = rest.expect("a radius that the node can have");
                let found = shape
                    .radius_at(insert, node, length, rest)
                    .expect("a chain");
                assert!(
                    (found - target).abs() <= 1e-12,
                    "{insert} {node} {length}: {found}"
                );
                // Control: the length matters.
                assert_eq!(rest == target, length == 0.2, "{rest} {target}");
            }
        }
    }

    #[test]
    fn a_radius_that_no_node_can_have_is_refused_with_what_it_can() {
        let shape = shape();
        assert_eq!(shape.radius_at_rest(0, 2, 0.16, 0.3), Err([0.0, 0.2]));
        assert_eq!(shape.radius_at_rest(0, 2, 0.16, f64::NAN), Err([0.0, 0.2]));
        // What the others give up is at the node even if it has nothing at rest.
        let least = shape.radius_at(0, 2, 0.12, 0.0).expect("a chain");
        assert!(least > 0.0, "{least}");
        let refused = shape.radius_at_rest(0, 2, 0.12, 0.5 * least);
        assert_eq!(refused, Err([least, 0.2]));
        assert!(shape.radius_at_rest(0, 2, 0.12, 1.1 * least).is_ok());
    }
}
