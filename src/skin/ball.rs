//! Skin over a rigid ball that rises from below.

use nalgebra::{Point3, Vector3};

use super::SkinError;
use super::areas::Areas;
use super::plan::{Inserted, PreparedPatch, over_ball};
use super::region::REACH;
use super::settle::{SettleMethod, SettleProgress, SkinSystem};

/// Number of points along the radius of a ball where the skin possibly leaves it.
const PLACES: u32 = 64;

/// A rigid ball: centre and radius [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Centre of the ball [m].
    pub centre: Point3<f64>,
    /// Radius of the ball [m].
    pub radius: f64,
}

impl PreparedPatch {
    /// Brings the skin to equilibrium over a ball, from the positions with the ball `before`.
    ///
    /// # Errors
    /// Equations without a solution, or [`SkinError::Stopped`].
    pub fn over_ball(
        &self,
        ball: Ball,
        before: Option<(&Inserted, Ball)>,
        watch: impl FnMut(&SettleProgress) -> bool,
    ) -> Result<Inserted, SkinError> {
        let model = self.model_over(&ball);
        let mut x = before.map_or_else(|| model.rest(), |(before, _)| before.x.clone());
        let up = self.frame * Vector3::z();
        x.iter_mut()
            .zip(self.raised(&ball))
            .for_each(|(p, lift)| *p += up * lift);
        if let Some((_, was)) = before {
            x.iter_mut()
                .zip(self.raised(&was))
                .for_each(|(p, lift)| *p -= up * lift);
        }
        let settled = model.settle_each(&mut x, watch)?;
        let areas = Areas::of(&self.layers, &x);
        Ok(Inserted {
            shells: Vec::new(),
            areas,
            progress: settled.progress,
            coarse_gain: None,
            x,
            lifts: settled.lifts,
        })
    }

    /// The system of the skin and a ball.
    pub(super) fn model_over(&self, ball: &Ball) -> SkinSystem {
        // Without an implant a constant factor is sufficient and several times as fast.
        let method = self.method.unwrap_or(SettleMethod::QuasiStatic);
        let membrane = self.order.tissue.membrane();
        over_ball(
            self.layers.clone(),
            membrane,
            ball.centre,
            ball.radius,
            method,
        )
    }

    /// Height of a taut skin over a ball above its rest position [m]: on the ball, and from there
    /// straight to the boundary.
    fn raised(&self, ball: &Ball) -> Vec<f64> {
        let centre = self.frame.inverse_transform_point(&ball.centre);
        let (base, rim) = (centre.z + self.order.tissue.depth, REACH * ball.radius);
        let on_ball = |r: f64| base + (ball.radius * ball.radius - r * r).max(0.0).sqrt();
        let slope = |r: f64| on_ball(r) / (rim - r);
        let places = (0..PLACES).map(|k| ball.radius * f64::from(k) / f64::from(PLACES));
        let leaves = places.fold(0.0, |best, r| if slope(r) > slope(best) { r } else { best });
        let mut raised = Vec::with_capacity(self.layers.rest.len());
        for (v, rest) in self.layers.rest.iter().enumerate() {
            let away = (self.frame.inverse_transform_point(rest).xy() - centre.xy()).norm();
            let taut = if away < leaves {
                on_ball(away)
            } else {
                slope(leaves) * (rim - away)
            };
            raised.push(if self.layers.held[v] {
                0.0
            } else {
                taut.max(0.0)
            });
        }
        raised
    }
}
