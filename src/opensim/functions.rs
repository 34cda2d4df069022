//! Functions of coordinates.

use super::document::{Element, MALFORMED, ModelError, UNKNOWN_KIND};

/// Greatest nesting of multipliers; deeper text would exhaust the stack.
const DEEPEST: usize = 16;
/// Least distance of two abscissae in the equations of a spline: that of OpenSim, whose values are
/// reproduced.
const CLOSEST: f64 = 1e-13;

/// A function of some coordinates.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Function {
    Constant(f64),
    /// Coefficients of the arguments, then the constant.
    Linear(Vec<f64>),
    /// Coefficients, the highest power first.
    Polynomial(Vec<f64>),
    Spline(Spline),
    PiecewiseLinear(Vec<[f64; 2]>),
    /// Amplitude, angular frequency, phase, offset.
    Sine([f64; 4]),
    Multiplier(f64, Box<Function>),
    /// Coefficients in lexicographic order of the exponents, number of arguments, order.
    Multivariate(Vec<f64>, usize, usize),
}

impl Function {
    /// The function in an element, which is the function itself or contains it.
    pub(super) fn read(element: Element<'_>) -> Result<Self, ModelError> {
        Self::nested(element, 0)
    }

    fn nested(element: Element<'_>, depth: usize) -> Result<Self, ModelError> {
        if depth > DEEPEST {
            let message = format!("functions are nested deeper than {DEEPEST}");
            return Err(element.error(MALFORMED, message));
        }
        Ok(match element.tag() {
            "Constant" => Self::Constant(one(element, "value")?),
            "LinearFunction" => Self::Linear(some(element, "coefficients")?),
            "PolynomialFunction" => Self::Polynomial(some(element, "coefficients")?),
            "SimmSpline" | "NaturalCubicSpline" => Self::Spline(Spline::new(&points(element)?)),
            "PiecewiseLinearFunction" => Self::PiecewiseLinear(points(element)?),
            "Sine" => {
                let keys = [
                    ("amplitude", 1.0),
                    ("omega", 1.0),
                    ("phase", 0.0),
                    ("offset", 0.0),
                ];
                let mut all = [0.0; 4];
                for (value, (tag, default)) in all.iter_mut().zip(keys) {
                    [*value] = element.numbers_or(tag, [default])?;
                }
                Self::Sine(all)
            }
            "MultiplierFunction" => {
                let inner = Self::inside(element.need("function")?, depth)?;
                let [scale] = element.numbers_or("scale", [1.0])?;
                Self::Multiplier(scale, Box::new(inner))
            }
            "MultivariatePolynomialFunction" => {
                let (dimension, order) = (whole(element, "dimension")?, whole(element, "order")?);
                let all = element.need("coefficients")?.numbers()?;
                if dimension > 6 || order > 9 {
                    let message = format!(
                        "a polynomial of {dimension} arguments and order {order} is not read"
                    );
                    return Err(element.error(UNKNOWN_KIND, message));
                }
                let count = super::paths::exponents(dimension, order).len();
                if all.len() != count {
                    let message = format!("{} coefficients instead of {count}", all.len());
                    return Err(element.error(MALFORMED, message));
                }
                Self::Multivariate(all, dimension, order)
            }
            "function" | "coupled_coordinates_function" => return Self::inside(element, depth),
            tag => {
                return Err(
                    element.error(UNKNOWN_KIND, format!("the function <{tag}> is not read"))
                );
            }
        })
    }

    fn inside(element: Element<'_>, depth: usize) -> Result<Self, ModelError> {
        let first = element.children().next().ok_or_else(|| {
            element.error(
                MALFORMED,
                format!("<{}> contains no function", element.tag()),
            )
        })?;
        Self::nested(first, depth + 1)
    }

    /// Number of arguments, if it is fixed.
    pub(super) fn arguments(&self) -> Option<usize> {
        match self {
            Self::Constant(_) => None,
            Self::Linear(all) => Some(all.len() - 1),
            Self::Multivariate(_, dimension, _) => Some(*dimension),
            Self::Multiplier(_, inner) => inner.arguments(),
            _ => Some(1),
        }
    }

    /// The value at some arguments; missing arguments are 0.
    pub(super) fn at(&self, arguments: &[f64]) -> f64 {
        let x = arguments.first().copied().unwrap_or(0.0);
        match self {
            Self::Constant(value) => *value,
            Self::Linear(all) => {
                let (constant, slopes) = all.split_last().unwrap_or((&0.0, &[]));
                let sum: f64 = slopes.iter().zip(arguments).map(|(c, x)| c * x).sum();
                sum + constant
            }
            Self::Polynomial(all) => all.iter().fold(0.0, |sum, c| sum * x + c),
            Self::Spline(spline) => spline.at(x),
            Self::PiecewiseLinear(points) => piecewise(points, x),
            Self::Sine([amplitude, omega, phase, offset]) => {
                amplitude * libm::sin(omega * x + phase) + offset
            }
            Self::Multiplier(scale, inner) => scale * inner.at(arguments),
            Self::Multivariate(all, dimension, order) => {
                let mut whole = vec![0.0; *dimension];
                whole.iter_mut().zip(arguments).for_each(|(w, a)| *w = *a);
                super::paths::value(all, &super::paths::exponents(*dimension, *order), &whole)
            }
        }
    }
}

/// The number in a child.
fn one(element: Element<'_>, tag: &str) -> Result<f64, ModelError> {
    let [value] = element.need(tag)?.exactly()?;
    Ok(value)
}

/// The numbers in a child, at least one.
fn some(element: Element<'_>, tag: &str) -> Result<Vec<f64>, ModelError> {
    let all = element.need(tag)?.numbers()?;
    match all.is_empty() {
        true => Err(element.error(MALFORMED, format!("<{tag}> has no numbers"))),
        false => Ok(all),
    }
}

/// The small whole number in a child.
fn whole(element: Element<'_>, tag: &str) -> Result<usize, ModelError> {
    let value = one(element, tag)?;
    match value.fract() == 0.0 && (0.0..=20.0).contains(&value) {
        true => Ok(value as usize),
        false => Err(element.error(MALFORMED, format!("<{tag}> is not 0 to 20"))),
    }
}

/// The points of `<x>` and `<y>`, ascending in x.
fn points(element: Element<'_>) -> Result<Vec<[f64; 2]>, ModelError> {
    let [x, y] = ["x", "y"].map(|tag| element.need(tag).and_then(Element::numbers));
    let (x, y) = (x?, y?);
    if x.len() != y.len() || x.len() < 2 {
        let message = format!(
            "<{}> has {} abscissae and {} ordinates; it needs two of each, and equal numbers",
            element.tag(),
            x.len(),
            y.len()
        );
        return Err(element.error(MALFORMED, message));
    }
    if !x.windows(2).all(|pair| pair[0] < pair[1]) {
        let message = format!("the abscissae of <{}> do not ascend", element.tag());
        return Err(element.error(MALFORMED, message));
    }
    Ok(x.into_iter().zip(y).map(|(x, y)| [x, y]).collect())
}

/// Straight lines between points; the first and the last are continued.
fn piecewise(points: &[[f64; 2]], x: f64) -> f64 {
    let next = points.partition_point(|p| p[0] <= x);
    let k = next.clamp(1, points.len() - 1);
    let [[x0, y0], [x1, y1]] = [points[k - 1], points[k]];
    y0 + (x - x0) * (y1 - y0) / (x1 - x0)
}

/// The cubic spline of SIMM \[forsythe1977\]: at each end its third derivative is that of the cubic
/// through the four outermost points. It is straight outside of its points.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Spline {
    points: Vec<[f64; 2]>,
    /// Coefficients of the first, second and third power of the distance from each point.
    powers: Vec<[f64; 3]>,
}

impl Spline {
    /// The spline through two points or more, with ascending first coordinates.
    pub(crate) fn new(points: &[[f64; 2]]) -> Self {
        let n = points.len();
        let y = |k: usize| points[k][1];
        let width = |from: usize, to: usize| f64::max(CLOSEST, points[to][0] - points[from][0]);
        let mut powers = vec![[0.0; 3]; n];
        if n == 2 {
            let slope = (y(1) - y(0)) / width(0, 1);
            powers.iter_mut().for_each(|p| p[0] = slope);
        } else {
            let (mut b, mut c, mut d) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            // The tridiagonal system of the second derivatives.
            d[0] = width(0, 1);
            c[1] = (y(1) - y(0)) / d[0];
            for i in 1..n - 1 {
                d[i] = width(i, i + 1);
                b[i] = 2.0 * (d[i - 1] + d[i]);
                c[i + 1] = (y(i + 1) - y(i)) / d[i];
                c[i] = c[i + 1] - c[i];
            }
            b[0] = -d[0];
            b[n - 1] = -d[n - 2];
            c[0] = 0.0;
            c[n - 1] = 0.0;
            if n > 3 {
                c[0] = c[2] / width(1, 3) - c[1] / width(0, 2);
                c[n - 1] = c[n - 2] / width(n - 3, n - 1) - c[n - 3] / width(n - 4, n - 2);
                c[0] = c[0] * d[0] * d[0] / width(0, 3);
                c[n - 1] = -c[n - 1] * d[n - 2] * d[n - 2] / width(n - 4, n - 1);
            }
            for i in 1..n {
                let factor = d[i - 1] / b[i - 1];
                b[i] -= factor * d[i - 1];
                c[i] -= factor * c[i - 1];
            }
            c[n - 1] /= b[n - 1];
            for i in (0..n - 1).rev() {
                c[i] = (c[i] - d[i] * c[i + 1]) / b[i];
            }
            b[n - 1] = (y(n - 1) - y(n - 2)) / d[n - 2] + d[n - 2] * (c[n - 2] + 2.0 * c[n - 1]);
            for i in 0..n - 1 {
                b[i] = (y(i + 1) - y(i)) / d[i] - d[i] * (c[i + 1] + 2.0 * c[i]);
                d[i] = (c[i + 1] - c[i]) / d[i];
                c[i] *= 3.0;
            }
            c[n - 1] *= 3.0;
            d[n - 1] = d[n - 2];
            powers = (0..n).map(|i| [b[i], c[i], d[i]]).collect();
        }
        Self {
            points: points.to_vec(),
            powers,
        }
    }

    /// The value at `q`.
    pub(crate) fn at(&self, q: f64) -> f64 {
        let (first, last) = (0, self.points.len() - 1);
        let straight = |k: usize| self.points[k][1] + (q - self.points[k][0]) * self.powers[k][0];
        if q < self.points[first][0] {
            return straight(first);
        }
        if q > self.points[last][0] {
            return straight(last);
        }
        let k = self.points.partition_point(|p| p[0] <= q);
        let k = k.saturating_sub(1).min(last);
        let h = q - self.points[k][0];
        let [b, c, d] = self.powers[k];
        self.points[k][1] + h * (b + h * (c + h * d))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::opensim::document::Parsed;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Function, ModelError> {
        let whole = format!("<OpenSimDocument Version=\"40600\">{text}</OpenSimDocument>");
        let parsed = Parsed::new(&whole, "f.osim")?;
        Function::read(parsed.root().children().next().expect("an element"))
    }

    #[test]
    fn each_kind_has_its_value() {
        let cases = [
            ("<Constant><value>0.25</value></Constant>", 2.0, 0.25),
            (
                "<LinearFunction><coefficients>2 1</coefficients></LinearFunction>",
                3.0,
                7.0,
            ),
            (
                "<PolynomialFunction><coefficients>1 0 -1</coefficients></PolynomialFunction>",
                3.0,
                8.0,
            ),
            (
                "<PiecewiseLinearFunction><x>0 1 3</x><y>0 2 2</y></PiecewiseLinearFunction>",
                0.5,
                1.0,
            ),
            (
                "<PiecewiseLinearFunction><x>0 1 3</x><y>0 2 2</y></PiecewiseLinearFunction>",
                -1.0,
                -2.0,
            ),
            (
                "<PiecewiseLinearFunction><x>0 1 3</x><y>0 2 2</y></PiecewiseLinearFunction>",
                9.0,
                2.0,
            ),
            (
                "<Sine><amplitude>2</amplitude><omega>1</omega><phase>0</phase><offset>1</offset></Sine>",
                0.0,
                1.0,
            ),
            (
                "<MultiplierFunction><function><Constant><value>3</value></Constant></function><scale>2</scale></MultiplierFunction>",
                0.0,
                6.0,
            ),
            ("<SimmSpline><x>0 2</x><y>0 4</y></SimmSpline>", 5.0, 10.0),
        ];
        for (text, x, value) in cases {
            let function = read(text).expect(text);
            assert!((function.at(&[x]) - value).abs() < 1e-14, "{text}");
        }
        let two = read(
            "<MultivariatePolynomialFunction><coefficients>1 2 3 4 5 6</coefficients><dimension>2</dimension><order>2</order></MultivariatePolynomialFunction>",
        );
        // 1 + 2 y + 3 y^2 + 4 x + 5 x y + 6 x^2
        let value = two.expect("a polynomial").at(&[2.0, 3.0]);
        assert_eq!(value, 1.0 + 6.0 + 27.0 + 8.0 + 30.0 + 24.0);
    }

    #[test]
    fn what_is_no_function_is_refused_with_its_place() {
        let wrong = [
            "<GCVSpline/>",
            "<SimmSpline><x>0 1</x><y>0</y></SimmSpline>",
            "<SimmSpline><x>1 1</x><y>0 0</y></SimmSpline>",
            "<LinearFunction><coefficients/></LinearFunction>",
            "<LinearFunction><coefficients>1 nan</coefficients></LinearFunction>",
            "<Constant/>",
            "<MultiplierFunction><function/></MultiplierFunction>",
            "<MultivariatePolynomialFunction><coefficients>1</coefficients><dimension>2</dimension><order>2</order></MultivariatePolynomialFunction>",
        ];
        for text in wrong {
            let error = read(text).expect_err(text);
            assert!(error.line == 1 && error.column > 30, "{error}");
        }
        let deep = format!(
            "{}<Constant/>{}",
            "<MultiplierFunction><function>".repeat(500),
            "</function></MultiplierFunction>".repeat(500)
        );
        assert!(read(&deep).is_err());
    }

    proptest! {
        /// The end conditions make the spline exact on cubics, also at its ends; and its value and
        /// slope are continuous.
        #[test]
        fn a_spline_is_exact_on_cubics(c in prop::array::uniform4(-1.0..1.0_f64), steps in prop::collection::vec(0.1..1.0_f64, 4..9), at in 0.0..1.0_f64) {
            let cubic = |x: f64| c.iter().rev().fold(0.0, |sum, c| sum * x + c);
            let mut x = -1.0;
            let mut points = vec![[x, cubic(x)]];
            for step in steps {
                x += step;
                points.push([x, cubic(x)]);
            }
            let spline = Spline::new(&points);
            let q = -1.0 + at * (x + 1.0);
            prop_assert!((spline.at(q) - cubic(q)).abs() <= 1e-11, "{} {}", spline.at(q), cubic(q));
        }
    }
}
