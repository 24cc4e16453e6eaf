//! Links of bodies side by side.

use super::{Link, Twist};
use phipsi_spatial::{Abreast, Real, Turn, Vec3};

impl<C: Real> Link<C> {
    /// The links of four bodies in lanes. Of different shapes they are oblique ones, whose lanes multiply where a quarter turn exchanges.
    pub(crate) fn abreast(links: [&Self; 4]) -> Link<C::Abreast> {
        let number = |of: &dyn Fn(&Self) -> C| C::Abreast::of(links.map(of));
        let turn = |of: &dyn Fn(&Self) -> Turn<C>| Turn {
            cos: number(&|link| of(link).cos),
            sin: number(&|link| of(link).sin),
        };
        let offset = |i: usize| number(&|link| link.offset.0[i]);
        let same = links.iter().all(|link| link.shape == links[0].shape);
        Link {
            first: turn(&|link| link.first),
            twist: turn(&|link| link.twist),
            last: turn(&|link| link.last),
            offset: Vec3([offset(0), offset(1), offset(2)]),
            shape: if same { links[0].shape } else { Twist::Oblique },
            has_first: links.iter().any(|link| link.has_first),
            concentric: links.iter().all(|link| link.concentric),
        }
    }
}
